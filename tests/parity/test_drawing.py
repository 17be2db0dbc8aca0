"""What the offscreen renderer, the page and the comparison promise."""

import dataclasses

import jax
import numpy as np
import pytest

import impostor_jax as ij
from experiments.published_faults.run import SHADERS
from impostor_jax.glsl import offscreen
from impostor_jax.glsl.batches import batches_in_camera
from impostor_jax.glsl.conventions import depth_range
from impostor_jax.glsl.draw_list import draw_list_of
from impostor_jax.glsl.impostors import Impostor
from impostor_jax.glsl.offscreen import DriverError, OffscreenRenderer
from impostor_jax.glsl.program import attributes
from impostor_jax.glsl.webgl import WebglRenderer, page
from impostor_jax.parity.compare import compare, edge_band
from impostor_jax.parity.run import drawn_by_jax
from tests.groups import FULL

moderngl = pytest.importorskip("moderngl")

CAMERA = ij.PinholeCamera(150.0, 140.0, 70.0, 66.0, width=160, height=120)
ROD = ij.Cylinder((0.05, -0.04, 0.6), (0.6, 0.7, 0.3), 0.02, 0.3)
BALL = ij.Sphere((-0.05, 0.06, 0.5), 0.04)


def test_rows_and_columns_are_those_of_the_camera(renderer):
    drawn, maps = renderer.draw(ROD, CAMERA), ij.render(ROD, CAMERA)
    np.testing.assert_array_equal(drawn.mask, np.asarray(maps.mask))
    assert not (drawn.mask == drawn.mask[::-1]).all()
    assert not (drawn.mask == drawn.mask[:, ::-1]).all()


def test_pose_of_the_camera_is_used(renderer):
    turned = np.array(
        [[0.0, -1, 0, 0.01], [1, 0, 0, 0.02], [0, 0, 1, 0.1], [0, 0, 0, 1]]
    )
    camera = ij.PinholeCamera(150.0, 140.0, 70.0, 66.0, 160, 120, None, False, turned)
    found = compare(drawn_by_jax(ROD, camera), renderer.draw(ROD, camera))
    assert found.flips_off_band == 0
    assert found.depth_relative.p999 < 1e-6


def test_depth_buffer_holds_the_depth(renderer):
    drawn = renderer.draw(ROD, CAMERA)
    apart = drawn.buffer_depth[drawn.mask] - drawn.depth[drawn.mask]
    assert np.abs(apart).max() < draw_list_of(ROD, CAMERA).stretch.length * 2.0**-22


def test_depth_buffer_reaches_to_infinity_where_something_has_no_end():
    center = np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 5.0]])
    stretch = depth_range(center, np.array([np.inf, 1.0]))
    assert stretch.near == 0
    window = np.array([[0.0, 0.5, 1.0]])
    middle = np.sqrt(26) + 1
    np.testing.assert_allclose(stretch.meters(window), [[0, middle, np.inf]])
    # Without it the buffer is linear around all that is drawn.
    stretch = depth_range(center[1:], np.array([1.0]))
    np.testing.assert_allclose(stretch.meters(window), [[3.998, 5, 6.002]])


def test_closest_of_overlapping_cylinders_wins_in_any_order(renderer):
    center = np.array([[0.0, 0.0, 0.5], [0.01, 0.0, 0.7], [0.0, 0.02, 0.6]])
    axis, radius = np.array([[0, 1, 0.2]] * 3), np.array([0.05, 0.2, 0.12])
    for order in ([0, 1, 2], [2, 1, 0], [1, 2, 0]):
        several = ij.Cylinder(
            center[order], axis[order], radius[order], np.full(3, 0.3)
        )
        drawn, reference = (
            renderer.draw(several, CAMERA),
            drawn_by_jax(several, CAMERA),
        )
        off = ~edge_band(reference.index)
        np.testing.assert_array_equal(drawn.index[off], reference.index[off])
        seen = {order[k] for k in np.unique(drawn.index[drawn.mask])}
        assert seen == {0, 1, 2}


def test_index_counts_through_a_sequence_of_batches_and_single_primitives(renderer):
    center = np.array([[-0.1, 0.0, 0.5], [0.1, 0.0, 0.5]])
    balls = ij.Sphere(center, np.array([0.03, 0.03]))
    drawn = renderer.draw([balls, ROD, BALL], CAMERA)
    for index, one in enumerate([*_singles(balls), ROD, BALL]):
        seen = np.asarray(ij.render(one, CAMERA, outputs=("mask",)).mask)
        assert (drawn.index[seen] == index).mean() > 0.5
    assert set(np.unique(drawn.index)) == {-1, 0, 1, 2, 3}


@FULL
def test_closest_of_mixed_primitives_wins_in_any_order(renderer):
    scene = {
        "can": ij.Cylinder((0.0, 0.0, 0.6), (0.3, 1, 0.2), 0.05, 0.3),
        "front": ij.Sphere((0.03, 0.02, 0.5), 0.05),
        "back": ij.Sphere((-0.05, 0.0, 0.7), 0.15),
        "rod": ROD,
    }
    kept = []
    for order in (list(scene), list(scene)[::-1], ["rod", "back", "can", "front"]):
        primitives = [scene[name] for name in order]
        drawn, reference = (
            draw(primitives, CAMERA) for draw in (renderer.draw, drawn_by_jax)
        )
        off = ~edge_band(reference.index)
        np.testing.assert_array_equal(drawn.index[off], reference.index[off])
        both = drawn.mask & reference.mask & off
        np.testing.assert_allclose(drawn.depth[both], reference.depth[both], rtol=1e-6)
        names = np.array([*order, "nothing"])[drawn.index]
        assert set(names[drawn.mask]) == set(scene)
        kept.append(names)
    np.testing.assert_array_equal(kept[0], kept[1])
    np.testing.assert_array_equal(kept[0], kept[2])


def test_matrix_of_an_instance_comes_row_by_row():
    box = Impostor("box", {"rotation": 9, "radius": 1}, lambda boxes: None)
    rows = [(f"instance_rotation_{row}", 3) for row in range(3)]
    assert attributes(box) == [*rows, ("instance_radius", 1), ("instance_index", 1)]


def _singles(batch):
    """The primitives of a batch, one by one."""
    return [
        jax.tree.map(lambda field, k=k: field[k], batch)
        for k in range(batch.batch_shape[0])
    ]


def test_camera_inside_a_sphere_sees_its_wall_everywhere(renderer):
    ball = ij.Sphere((0.3, -0.2, 0.4), 1.0)
    drawn = renderer.draw(ball, CAMERA)
    assert drawn.mask.all()
    away = np.linalg.norm(drawn.point - np.asarray(ball.center), axis=-1)
    np.testing.assert_allclose(away, 1, atol=1e-6)
    assert (np.sum(drawn.normal * drawn.point, axis=-1) < 0).all()


def test_lens_and_wrong_types_are_named():
    lens = ij.PinholeCamera(150.0, 150.0, 79.5, 59.5, 160, 120, (0.1, 0, 0, 0, 0))
    with pytest.raises(ValueError, match="camera must have no lens"):
        batches_in_camera(ROD, lens)
    with pytest.raises(ValueError, match="camera must be a PinholeCamera or"):
        batches_in_camera(ROD, None)
    with pytest.raises(ValueError, match="primitives must be one primitive of Box"):
        batches_in_camera([ROD, CAMERA], CAMERA)
    with pytest.raises(ValueError, match="primitives must hold at least one"):
        batches_in_camera([], CAMERA)


def test_driver_must_be_known_and_one_for_the_process(renderer):
    with pytest.raises(ValueError, match="driver must be one of"):
        OffscreenRenderer("vulkan")
    with pytest.raises(ValueError, match="driver must be 'llvmpipe', which this"):
        OffscreenRenderer("softpipe")


def test_folder_of_shaders_must_be_there(renderer):
    with OffscreenRenderer(shaders=SHADERS / "none") as nowhere:
        with pytest.raises(ValueError, match="shaders must be a folder with shaders"):
            nowhere.draw(ROD, CAMERA)


def test_missing_driver_names_the_packages_to_install(monkeypatch):
    def fail(**settings):
        raise Exception("libEGL.so.1 not loaded")

    monkeypatch.setattr(moderngl, "create_context", fail)
    with pytest.raises(DriverError, match=r"apt-get install.*libegl1 libgl1"):
        OffscreenRenderer()
    assert offscreen._chosen in ([], ["llvmpipe"])


def test_closed_renderer_draws_no_more(renderer):
    found = OffscreenRenderer()
    found.close()
    found.close()
    with pytest.raises(ValueError, match="the renderer is closed"):
        found.draw(ROD, CAMERA)
    assert renderer.draw(ROD, CAMERA).mask.any()


def test_renderers_side_by_side_keep_their_own_programs(renderer):
    # The second one's program was once drawn by the first, which had the same number.
    before = renderer.draw(ROD, CAMERA)
    with OffscreenRenderer(shaders=SHADERS) as published:
        wrong = published.draw(ROD, CAMERA)
        after = renderer.draw(ROD, CAMERA)
    np.testing.assert_array_equal(before.normal, after.normal)
    assert np.abs(wrong.normal - after.normal).max() > 0.5


@pytest.mark.parametrize("half_height", [0.1, 0.4, 0.6, 2.0])
def test_published_cap_at_the_end_of_the_axis_flips_below_half_a_unit(
    renderer, half_height
):
    with OffscreenRenderer(shaders=SHADERS) as published:
        for sign in (1.0, -1.0):
            # The camera sees the cap at -axis where the axis points away from it.
            can = ij.Cylinder(
                (0, 0, 10 * half_height), (0, 0.3 * sign, sign), half_height,
                2 * half_height,
            )  # fmt: skip
            wrong, right = published.draw(can, CAMERA), renderer.draw(can, CAMERA)
            cap = (wrong.part > 0) & (right.part > 0)
            cosine = np.sum(wrong.normal * right.normal, axis=-1)[cap]
            flipped = sign > 0 and half_height < 0.5
            np.testing.assert_allclose(cosine, -1 if flipped else 1, atol=1e-5)


def test_published_camera_inside_sees_nothing(renderer):
    pipe = ij.Cylinder((0.1, 0, 0.2), (0.2, 0.3, 1), 1.0, 8.0)
    with OffscreenRenderer(shaders=SHADERS) as published:
        assert not published.draw(pipe, CAMERA).mask.any()
    assert renderer.draw(pipe, CAMERA).mask.all()


def test_published_normal_of_the_wall_is_that_of_a_sphere(renderer):
    with OffscreenRenderer(shaders=SHADERS) as published:
        wrong = published.draw(ROD, CAMERA)
    wall = wrong.part == 0
    outward = wrong.point[wall] - np.asarray(ROD.center)
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    np.testing.assert_allclose(wrong.normal[wall], outward, atol=1e-5)


def test_page_needs_nothing_from_the_network():
    text = page(ROD, CAMERA)
    assert "http" not in text
    assert "src=" not in text
    assert "href=" not in text


@FULL
def test_page_shows_the_primitives_where_they_are(tmp_path):
    pytest.importorskip("playwright")
    try:
        browser = WebglRenderer()
    except DriverError as error:
        pytest.skip(str(error))
    with browser:
        drawn = browser.draw([BALL, ROD], CAMERA)
        path = tmp_path / "page.html"
        path.write_text(page([BALL, ROD], CAMERA))
        browser._page.goto(path.as_uri())
        note = browser._page.inner_text("#note")
        assert note.startswith("1 sphere(s), 1 cylinder(s), colored")
        shown = browser._page.evaluate(
            """() => {
              const canvas = document.getElementById("view");
              const context = canvas.getContext("2d");
              return Array.from(
                context.getImageData(0, 0, canvas.width, canvas.height).data);
            }"""
        )
    pixels = np.array(shown).reshape(120, 160, 4)[..., :3]
    np.testing.assert_array_equal((pixels != 255).any(axis=-1), drawn.mask)
    for index, one in enumerate((BALL, ROD)):
        seen = np.asarray(ij.render(one, CAMERA, outputs=("mask",)).mask)
        np.testing.assert_array_equal(drawn.index == index, seen)


def test_missing_browser_names_the_package(monkeypatch):
    pytest.importorskip("playwright")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(DriverError, match=r"apt-get install.*chromium"):
        WebglRenderer()


@FULL
def test_comparison_counts_what_differs():
    reference = drawn_by_jax(ROD, CAMERA)
    same = compare(reference, reference)
    assert same.flips_on_band == same.flips_off_band == same.part_flips == 0
    assert same.depth_ulp.worst == same.normal_deg.worst == 0
    inner = reference.mask & ~edge_band(reference.index)
    row, col = np.argwhere(inner)[0]
    index, depth = reference.index.copy(), reference.depth.copy()
    index[row, col] = -1
    edge_row, edge_col = np.argwhere(reference.mask & ~inner)[0]
    index[edge_row, edge_col] = -1
    other = tuple(np.argwhere(inner)[1])
    depth[other] = np.nextafter(np.nextafter(depth[other], np.inf), np.inf)
    found = compare(reference, dataclasses.replace(reference, index=index, depth=depth))
    assert (found.flips_off_band, found.flips_on_band) == (1, 1)
    assert found.depth_ulp.worst == 2
    assert found.depth_ulp.median == 0
