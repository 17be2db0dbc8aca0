"""The command line as a user runs it, in a process of its own where that matters."""

import json
import math
import os
import re
import subprocess
import sys

import cv2
import numpy as np
import pytest

from impostor_jax.__main__ import main
from impostor_jax.caching import keep_compiled
from tests.groups import FULL, LARGE_IMAGES, RELEASE, SMALL_IMAGES
from tests.schemas import validator

CAMERA = {"fx": 150.0, "fy": 150.0, "cx": 79.5, "cy": 59.5, "width": 160, "height": 120}
RECORD_KEYS = {
    "version", "success", "status", "reason", "shape", "source", "world_from_object",
    "center_m", "axis", "radius_m", "height_m", "std", "std_budget", "ends_seen",
    "height_observed", "stands", "covariance", "num_starts", "num_agreeing",
    "alternatives",
    "num_pixels", "rms_m", "chi2", "across_ray", "form", "pose_errors", "outline_gap",
    "taper", "bore", "seconds",
}  # fmt: skip


def run(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "impostor_jax", *map(str, arguments)],
        capture_output=True,
        text=True,
    )


@pytest.fixture
def call(monkeypatch):
    """Run a command in this process, which has JAX and fits ready; its exit code."""

    def run_here(*arguments):
        monkeypatch.setattr(sys, "argv", ["impostor-jax", *map(str, arguments)])
        try:
            return main()
        except SystemExit as stop:
            return stop.code

    return run_here


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """Folder that `render` wrote."""
    folder = tmp_path_factory.mktemp("rendered")
    (folder / "given.json").write_text(json.dumps(CAMERA))
    found = run(
        "render", "--camera", folder / "given.json", "--center", 0.01, -0.005, 0.35,
        "--axis", -0.5, 0.7, 0.5, "--radius", 0.04, "--height", 0.12,
        "--output", folder,
    )  # fmt: skip
    assert (found.returncode, found.stderr) == (0, "")
    return folder


@FULL
@SMALL_IMAGES
def test_render_writes_what_fit_reads(rendered, tmp_path, call, capfd):
    names = {entry.name for entry in rendered.iterdir()}
    assert names == {
        "given.json", "camera.json", "depth.png", "depth.tiff", "index.png", "mask.png",
        "normal.png",
    }  # fmt: skip
    exact = cv2.imread(str(rendered / "depth.tiff"), cv2.IMREAD_UNCHANGED)
    coarse = cv2.imread(str(rendered / "depth.png"), cv2.IMREAD_UNCHANGED)
    scale = json.loads((rendered / "camera.json").read_text())["depth_scale_m"]
    np.testing.assert_allclose(coarse * scale, exact, atol=scale / 2 + 1e-7)
    code = call(
        "fit", rendered / "depth.png", "--camera", rendered / "camera.json",
        "--mask", rendered / "mask.png", "--test-taper", "--output", tmp_path,
    )  # fmt: skip
    printed = capfd.readouterr()
    assert (code, printed.err) == (0, "")
    assert "taper   not needed" in printed.out
    record = json.loads((tmp_path / "fit.json").read_text())
    assert set(record) == RECORD_KEYS
    validator("fit").validate(record)
    assert record["success"] is True
    assert record["status"] == "converged"
    assert record["radius_m"] == pytest.approx(0.04, abs=1e-4)
    # A rendered image has no background: the far end is not seen.
    assert record["height_observed"] is False
    assert sorted(record["ends_seen"]) == [False, True]
    assert record["reason"] == "The fit converged."
    assert 0 <= record["chi2"] < 1
    assert record["std"]["height_m"] is None
    assert record["std"]["radius_m"] > 0
    assert record["taper"]["needed"] is False
    assert record["taper"]["p_value"] > 0.01
    assert record["taper"]["radius1_m"] == pytest.approx(0.04, abs=1e-3)
    picture = cv2.imread(str(tmp_path / "overlay.png"))
    assert picture.shape[0] > 300
    assert picture.std() > 10
    pytest.importorskip("trimesh")
    mesh = tmp_path / "can.stl"
    assert call("export", tmp_path / "fit.json", "--output", mesh) == 0
    assert mesh.is_file()


@FULL
@SMALL_IMAGES
def test_record_goes_where_it_is_told(rendered, tmp_path, call, capfd):
    (tmp_path / "records").mkdir()
    code = call(
        "fit", rendered / "depth.tiff", "--camera", rendered / "camera.json",
        "--output", tmp_path / "deep" / "out",
        "--json", tmp_path / "records" / "can.json",
    )  # fmt: skip
    assert code == 0
    assert "no mask: found an object of" in capfd.readouterr().out
    assert (tmp_path / "records" / "can.json").is_file()
    assert [p.name for p in (tmp_path / "deep" / "out").iterdir()] == ["overlay.png"]


@SMALL_IMAGES
def test_record_is_printed_alone(rendered, tmp_path, call, capfd):
    code = call(
        "fit", rendered / "depth.tiff", "--camera", rendered / "camera.json",
        "--mask", rendered / "mask.png", "--output", tmp_path, "--json", "-",
    )  # fmt: skip
    assert code == 0
    found = capfd.readouterr()
    assert set(json.loads(found.out)) == RECORD_KEYS
    assert found.err.startswith("converged")


@FULL
@SMALL_IMAGES
def test_effort_is_a_preset_with_dials_set_apart(rendered, tmp_path, call, capfd):
    code = call(
        "fit", rendered / "depth.tiff", "--camera", rendered / "camera.json",
        "--mask", rendered / "mask.png", "--output", tmp_path,
        "--effort", "fast", "--readings", 900, "--all-starts", "False",
    )  # fmt: skip
    assert (code, capfd.readouterr().err) == (0, "")
    record = json.loads((tmp_path / "fit.json").read_text())
    assert record["num_pixels"] == 900
    assert record["num_starts"] == 1


@FULL
def test_a_render_of_fewer_pixels_has_the_camera_of_these(rendered, tmp_path, call):
    scene = (
        "--center", 0.01, -0.005, 0.35, "--axis", -0.5, 0.7, 0.5, "--radius", 0.04,
        "--height", 0.12, "--camera", rendered / "given.json",
    )  # fmt: skip
    assert call("render", *scene, "--effort", "fast", "--output", tmp_path) == 0
    camera = json.loads((tmp_path / "camera.json").read_text())
    assert (camera["width"], camera["height"], camera["fx"]) == (80, 60, 75.0)
    few, all_ = (
        cv2.imread(str(folder / "depth.tiff"), cv2.IMREAD_UNCHANGED)
        for folder in (tmp_path, rendered)
    )
    np.testing.assert_allclose(few, all_[::2, ::2], rtol=1e-5)


def test_dials_that_do_not_go_together_are_refused(rendered, call, capfd):
    code = call(
        "fit", rendered / "depth.png", "--camera", rendered / "camera.json",
        "--outline", "hard", "--samples", 2,
    )  # fmt: skip
    assert code == 2
    found = capfd.readouterr().err.splitlines()
    assert len(found) == 1
    assert "samples must be 1 with outline" in found[0]


@SMALL_IMAGES
@RELEASE
def test_failed_fit_exits_with_1_and_writes_its_files(rendered, tmp_path, call, capfd):
    row, col = np.mgrid[0:120, 0:160]
    box = 0.5 + 0.002 * np.abs(col - 80) + 0.001 * np.abs(row - 60)
    np.save(tmp_path / "box.npy", box)
    code = call(
        "fit", tmp_path / "box.npy", "--camera", rendered / "camera.json",
        "--mask", rendered / "mask.png", "--output", tmp_path, "--effort", "fast",
    )  # fmt: skip
    assert (code, capfd.readouterr().err) == (1, "")
    record = json.loads((tmp_path / "fit.json").read_text())
    validator("fit").validate(record)
    assert record["success"] is False
    assert record["status"] != "converged"
    assert record["std"]["radius_m"] is None
    assert (tmp_path / "overlay.png").is_file()


@FULL
@LARGE_IMAGES
def test_demo_prints_truth_beside_the_fit(tmp_path):
    found = run("demo", "--output", tmp_path)
    assert (found.returncode, found.stderr) == (0, "")
    assert "true    fitted       std" in found.stdout
    assert "converged" in found.stdout
    assert {entry.name for entry in tmp_path.iterdir()} == {
        "camera.json", "depth.png", "fit.json", "overlay.png",
    }  # fmt: skip


def test_scene_file_is_rendered(tmp_path, call, capfd):
    shapes = [
        {"type": "sphere", "center": [0, 0, 0.5], "radius": 0.1},
        {"type": "plane", "point": [0, 0, 1], "normal": [0, 0, 1]},
        {"type": "sphere", "center": [0, 0, 2], "radius": 0.1},
    ]
    record = {"version": 1, "camera": CAMERA, "shapes": shapes}
    (tmp_path / "scene.json").write_text(json.dumps(record))
    assert call("render", tmp_path / "scene.json", "--output", tmp_path / "maps") == 0
    assert "19200 of 19200 pixels see 2 of 3 shapes" in capfd.readouterr().out
    index = cv2.imread(str(tmp_path / "maps" / "index.png"), cv2.IMREAD_UNCHANGED)
    assert index.dtype == np.uint16
    assert (index[60, 80], index[5, 5]) == (1, 2)
    depth = cv2.imread(str(tmp_path / "maps" / "depth.tiff"), cv2.IMREAD_UNCHANGED)
    assert depth[5, 5] == pytest.approx(1.0)


def test_range_image_is_rendered_and_what_needs_a_pinhole_refuses_it(
    tmp_path, call, capfd
):
    scanner = {
        "model": "spherical",
        "elevation_deg": [20, 9, 2, -2, -9, -20],
        "azimuth_deg": {"first": -176.25, "last": 176.25, "count": 48},
    }
    path, output = tmp_path / "scanner.json", tmp_path / "ranges"
    path.write_text(json.dumps(scanner))
    stem = ("--center", 0, 0, -6, "--axis", 0, 1, 0, "--radius", 1, "--height", 9)
    assert call("render", "--camera", path, *stem, "--output", output) == 0
    ranges = cv2.imread(str(output / "depth.tiff"), cv2.IMREAD_UNCHANGED)
    # The wall of a circle 6 m behind, 3.75 degrees aside, over the elevation's cosine.
    wall = 6 * math.cos(a := math.radians(3.75)) - (1 - (6 * math.sin(a)) ** 2) ** 0.5
    assert ranges[2, 0] == pytest.approx(wall / math.cos(math.radians(2)), rel=1e-5)
    assert not ranges[:, 1:-1].any()
    assert json.loads((output / "camera.json").read_text()) == {
        **scanner, "depth_scale_m": 1e-4,
    }  # fmt: skip
    capfd.readouterr()
    page = tmp_path / "page.html"
    assert call("render", "--camera", path, *stem, "--page", page) == 2
    assert "--page must have a pinhole camera" in capfd.readouterr().err
    assert not page.exists()


def test_mesh_of_a_scene_file_is_rendered(tmp_path, call, capfd):
    # A batch of triangles as the only shape.
    off = "OFF\n4 2 0\n-1 -1 0\n1 -1 0\n1 1 0\n-1 1 0\n3 0 1 2\n3 0 2 3\n"
    (tmp_path / "square.off").write_text(off)
    pytest.importorskip("trimesh")
    camera = {"fx": 60, "fy": 60, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48}
    camera["camera_from_world"] = [
        [1, 0, 0, 0],
        [0, 1, 0, 0],
        [0, 0, 1, 3],
        [0, 0, 0, 1],
    ]
    mesh = {"type": "mesh", "path": "square.off", "scale": 0.5}
    record = {"version": 1, "camera": camera, "shapes": [mesh]}
    (tmp_path / "scene.json").write_text(json.dumps(record))
    assert call("render", tmp_path / "scene.json", "--output", tmp_path / "maps") == 0
    assert "400 of 3072 pixels see 2 of 2 shapes" in capfd.readouterr().out


LIT = {
    "version": 1,
    "camera": {
        "fx": 24.0, "fy": 24.0, "cx": 11.5, "cy": 7.5, "width": 24, "height": 16,
    },
    "shapes": [
        {"type": "sphere", "center": [-0.05, 0, 1], "radius": 0.2,
         "material": {"color": [0.5, 0.25, 0.0]}},
        {"type": "sphere", "center": [0.25, 0, 1], "radius": 0.15,
         "material": {"color": [1.0, 0.0, 0.0], "reflect": 1.0}},
    ],
    "lights": [{"type": "ambient", "intensity": [1.0, 0.5, 3.0]}],
    "background": [0.0, 0.002, 4.0],
}  # fmt: skip


def test_a_lit_scene_is_rendered_as_a_picture(tmp_path, call, capfd):
    (tmp_path / "scene.json").write_text(json.dumps(LIT))
    # A mirror that no ray leaves has its own color.
    for bounces, mirrored in ((0, (1.0, 0.0, 0.0)), (1, LIT["background"])):
        output = tmp_path / str(bounces)
        code = call(
            "render", tmp_path / "scene.json", "--output", output, "--bounces", bounces
        )
        assert (code, capfd.readouterr().err) == (0, "")
        light = np.load(output / "picture.npy")
        assert (light.shape, light.dtype) == ((16, 24, 3), np.float32)
        ball, mirror, nothing = light[7, 10], light[7, 17], light[0, 0]
        np.testing.assert_allclose(ball, (0.5, 0.125, 0.0), atol=1e-6)
        np.testing.assert_allclose(mirror, mirrored, atol=1e-6)
        np.testing.assert_allclose(nothing, LIT["background"], atol=1e-6)
        levels = cv2.imread(str(output / "picture.png"), cv2.IMREAD_UNCHANGED)
        assert (levels.shape, levels.dtype) == ((16, 24, 3), np.uint8)
        # By the formula of sRGB: 188 of a half, 99 of an eighth; 0.002 is on its line.
        assert levels[7, 10].tolist() == [0, 99, 188]
        assert levels[0, 0].tolist() == [255, 7, 0]


def test_a_scene_without_lights_has_no_picture(tmp_path, call):
    dark = {key: value for key, value in LIT.items() if key != "lights"}
    (tmp_path / "scene.json").write_text(json.dumps(dark))
    assert call("render", tmp_path / "scene.json", "--output", tmp_path) == 0
    names = {entry.name for entry in tmp_path.iterdir()}
    assert "depth.png" in names
    assert not names & {"picture.png", "picture.npy"}


@pytest.mark.parametrize(
    ("changes", "arguments", "message"),
    [
        ({}, ("--bounces", "17"), "bounces must be a whole number from 0 to 16"),
        ({}, ("--bounces", "many"), "many"),
        (
            {"lights": [{"type": "lamp"}]},
            (),
            "type of lights[0] must be one of ambient",
        ),
        ({"background": [1, 2]}, (), "background must be numbers of shape (3,)"),
    ],
)
def test_a_bad_picture_gives_one_line_and_exit_code_2(
    changes, arguments, message, tmp_path, call, capfd
):
    (tmp_path / "scene.json").write_text(json.dumps(LIT | changes))
    output = tmp_path / "output"
    assert call("render", tmp_path / "scene.json", "--output", output, *arguments) == 2
    check_one_line(capfd.readouterr().err, message)
    assert not output.exists()


def test_a_page_is_written_alone_or_beside_the_images(tmp_path, call, capfd):
    (tmp_path / "scene.json").write_text(json.dumps(LIT))
    alone, beside = tmp_path / "scene.html", tmp_path / "output" / "scene.html"
    assert call("render", tmp_path / "scene.json", "--page", alone) == 0
    assert capfd.readouterr() == (f"{alone} shows 2 shapes\n", "")
    assert {entry.name for entry in tmp_path.iterdir()} == {"scene.json", "scene.html"}
    more = ("--output", beside.parent, "--bounces", 0)
    assert call("render", tmp_path / "scene.json", "--page", beside, *more) == 0
    assert "pixels see 2 of 2 shapes\n" in capfd.readouterr().out
    assert (beside.parent / "picture.png").is_file()
    for page, bounces in ((alone, 3), (beside, 0)):
        assert f"#define BOUNCES {bounces}\\n" in page.read_text()


def test_a_page_of_a_cylinder_is_lit_from_the_camera(rendered, call, capfd):
    code = call(
        "render", "--camera", rendered / "given.json", "--center", 0, 0, 0.3,
        "--axis", 0, 1, 0, "--radius", 0.04, "--height", 0.1, "--page", "-",
    )  # fmt: skip
    printed = capfd.readouterr()
    assert (code, printed.err) == (0, "- shows the cylinder\n")
    assert printed.out.startswith("<!DOCTYPE html>")
    assert '"headlight": {' in printed.out


@pytest.mark.parametrize(
    ("changes", "arguments", "message"),
    [
        ({}, (), "--output or --page must be given"),
        ({}, ("--page", "{folder}"), "page must be a file, got the folder"),
        ({}, ("--page", "{folder}/scene.json/page.html"), "Not a directory"),
        ({}, ("--page", "{folder}/page.html", "--bounces", "17"), "from 0 to 16"),
        (
            {"camera": LIT["camera"] | {"distortion": [0.1, 0, 0, 0, 0]}},
            ("--page", "{folder}/page.html", "--output", "{folder}/output"),
            "camera must have no lens",
        ),
    ],
)
def test_a_page_that_cannot_be_gives_one_line_and_exit_code_2(
    changes, arguments, message, tmp_path, call, capfd
):
    (tmp_path / "scene.json").write_text(json.dumps(LIT | changes))
    arguments = (argument.format(folder=tmp_path) for argument in arguments)
    assert call("render", tmp_path / "scene.json", *arguments) == 2
    check_one_line(capfd.readouterr().err, message)
    assert {entry.name for entry in tmp_path.iterdir()} == {"scene.json"}


FIT = ("fit", "{depth}", "--camera", "{camera}")


@SMALL_IMAGES
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "Expected one of {fit, find, track, calibrate, render, export, demo,"),
        (("mesh",), "mesh"),
        (("fit", "{depth}"), "--camera"),
        ((*FIT, "--speed", "9"), "Unrecognized options: --speed"),
        (("fit", "--camra", "{camera}"), "; did you mean --camera?"),
        ((*FIT, "--sigma", "small"), "--sigma must be FLOAT, got small"),
        ((*FIT, "--prior-radius", "0.04"), "-radius must be FLOAT FLOAT, got 0.04"),
        ((*FIT, "--sigma", "nan"), "sigma must be a positive number"),
        ((*FIT, "--sigma", "-1"), "sigma must be a positive number"),
        ((*FIT, "--mask", "{folder}/none.png"), "does not exist"),
        ((*FIT, "--mask", "{folder}/small.png"), "mask must have the camera's shape"),
        ((*FIT, "--mask", "{folder}/empty.png"), "mask must hold at least one pixel"),
        (("fit", "{folder}/none.png", "--camera", "{camera}"), "does not exist"),
        (("fit", "{folder}/negative.npy", "--camera", "{camera}"), "not be negative"),
        (("fit", "{folder}/few.npy", "--camera", "{camera}"), "at least 50 readings"),
        (("fit", "{png}", "--camera", "{folder}/given.json"), "depth_scale_m must be"),
        (("fit", "{depth}", "--camera", "{folder}/none.json"), "does not exist"),
        ((*FIT, "--output", "{depth}"), "output must be a folder, got the file"),
        ((*FIT, "--output", "/proc/x"), "can be made in the folder"),
        ((*FIT, "--output", ""), "--output must not be empty"),
        ((*FIT, "--json="), "--json must not be empty"),
        (("fit", "", "--camera", "{camera}"), "an argument must not be empty"),
        (
            ("render", "--camera", "{camera}", "--center", "0", "0", "1", "--axis", "0",
             "1", "0", "--radius", "0", "--height", "1", "--output", "{folder}/r"),
            "radius must be positive, in meters, got 0.0",
        ),
        (("render", "--camera", "{camera}", "--radius", "1", "--output", "{folder}/r"),
         "a scene file or --center, --axis, --height must be given"),
        (("render", "{folder}/scene.json", "--radius", "1", "--output", "{folder}/r"),
         "a scene file must not be given together with --radius"),
        (("render", "{folder}/scene.json", "--output", "{folder}/r"), "does not exist"),
    ],
)  # fmt: skip
def test_bad_input_gives_one_line_and_exit_code_2(
    arguments, message, rendered, tmp_path, call, capfd
):
    cv2.imwrite(str(tmp_path / "small.png"), np.full((9, 9), 255, np.uint8))
    cv2.imwrite(str(tmp_path / "empty.png"), np.zeros((120, 160), np.uint8))
    np.save(tmp_path / "negative.npy", np.full((120, 160), -1.0))
    few = np.zeros((120, 160))
    few[60, 60:90] = 1
    np.save(tmp_path / "few.npy", few)
    (tmp_path / "given.json").write_text((rendered / "given.json").read_text())
    places = {
        "depth": rendered / "depth.tiff",
        "png": rendered / "depth.png",
        "camera": rendered / "camera.json",
        "folder": tmp_path,
    }
    assert call(*(argument.format(**places) for argument in arguments)) == 2
    check_one_line(capfd.readouterr().err, message)


def check_one_line(errors, message):
    lines = errors.splitlines()
    assert len(lines) == 1, errors
    assert lines[0].startswith("impostor-jax: error: ")
    assert message in lines[0]


def test_bad_input_ends_the_process_with_one_line_and_exit_code_2():
    found = run("fit", "none.png", "--camera", "none.json")
    assert found.returncode == 2
    check_one_line(found.stderr, "does not exist")


def test_what_was_compiled_is_kept_where_the_user_keeps_caches(tmp_path, monkeypatch):
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    monkeypatch.delenv("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS")
    # What takes less than a tenth of a second to compile is not kept.
    monkeypatch.delenv("XLA_FLAGS")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    camera = tmp_path / "camera.json"
    camera.write_text(json.dumps(CAMERA))
    found = run(
        "render", "--camera", camera, "--output", tmp_path / "rendered",
        "--center", 0, 0, 0.5, "--axis", 0, 1, 0, "--radius", 0.04, "--height", 0.1,
    )  # fmt: skip
    assert (found.returncode, found.stderr) == (0, "")
    kept = tmp_path / "caches" / "impostor_jax" / "compiled"
    assert any("render" in entry.name for entry in kept.iterdir())


def test_the_users_own_cache_of_jax_is_used(tmp_path, monkeypatch):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    keep_compiled()
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == str(tmp_path)


def test_help_is_printed_without_starting_jax():
    program = (
        "import sys; from impostor_jax.cli.parse import parse\n"
        "try: parse(['fit', '--help'])\n"
        "except SystemExit as stop: assert not stop.code\n"
        "assert 'jax' not in sys.modules"
    )
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True
    )
    assert (found.returncode, found.stderr) == (0, "")
    assert "--sigma" in found.stdout


CUP = {
    "type": "difference",
    "shapes": [
        {"type": "cylinder", "center": [0, 0, 0.5], "axis": [0, 0, 1],
         "radius": 0.1, "height": 0.2},
        {"type": "union", "shapes": [
            {"type": "cylinder", "center": [0, 0, 0.4], "axis": [0, 0, 1],
             "radius": 0.05, "height": 0.2},
            {"type": "plane", "point": [0.05, 0, 0], "normal": [-1, 0, 0]},
        ]},
    ],
    "material": {"color": [0.5, 0.25, 0.0]},
}  # fmt: skip


def test_a_solid_of_a_scene_file_is_rendered(tmp_path, call, capfd):
    record = LIT | {"shapes": [CUP, LIT["shapes"][1]], "lights": []}
    (tmp_path / "scene.json").write_text(json.dumps(record))
    assert call("render", tmp_path / "scene.json", "--output", tmp_path / "maps") == 0
    assert "see 2 of 2 shapes" in capfd.readouterr().out
    depth = cv2.imread(str(tmp_path / "maps" / "depth.tiff"), cv2.IMREAD_UNCHANGED)
    # The bottom of the bore, the rim, and what is cut away.
    np.testing.assert_allclose(depth[7, [11, 7]], (0.5, 0.4), rtol=1e-6)
    assert not 0 < depth[7, 15] < 0.7


def test_a_scene_is_exported_as_a_mesh(tmp_path, call, capfd):
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("manifold3d")
    ball = {"type": "sphere", "center": [0, 0, 2], "radius": 0.1}
    (tmp_path / "scene.json").write_text(
        json.dumps({"version": 1, "shapes": [CUP, ball]})
    )
    for name in ("out.stl", "out.glb"):
        code = call(
            "export", tmp_path / "scene.json", "--output", tmp_path / name,
            "--tolerance", 0.0005, "--scale", 0.001,
        )  # fmt: skip
        found = capfd.readouterr()
        assert (code, found.err) == (0, "")
        assert "triangles of 2 shapes" in found.out
        mesh = trimesh.load_mesh(tmp_path / name)
        assert mesh.is_watertight
        np.testing.assert_allclose(mesh.bounds[:, 2], (400, 2100), rtol=1e-5)


def test_a_fit_is_exported_as_a_mesh(tmp_path, call, capfd):
    trimesh = pytest.importorskip("trimesh")
    fit = {"shape": "cylinder", "success": True, "center_m": [0, 0, 1],
           "axis": [0, 0, 1], "radius_m": 0.1, "height_m": 0.4}  # fmt: skip
    given, out = tmp_path / "fit.json", tmp_path / "out.ply"
    given.write_text(json.dumps(fit))
    assert call("export", given, "--output", out) == 0
    assert trimesh.load_mesh(out).volume == pytest.approx(np.pi * 0.004, rel=0.01)
    sizes = {"shape": "tube", "outer_radius_m": 0.1, "inner_radius_m": 0.05}
    given.write_text(json.dumps(fit | sizes))
    assert call("export", given, "--output", out) == 0
    assert trimesh.load_mesh(out).volume == pytest.approx(np.pi * 0.003, rel=0.01)
    for change, message in (
        (
            {"version": 2},
            "version of fit .* must be at most 1, got 2: it is of a newer",
        ),
        ({"success": False}, "must have succeeded"),
        ({"shape": "knot"}, "shape of fit .* must be one of"),
        ({"radius_m": None}, "radius must be"),
        ({"height_n": 1, "height_m": "tall"}, "height must"),
    ):
        given.write_text(json.dumps(fit | change))
        assert call("export", given, "--output", out) == 2
        (line,) = capfd.readouterr().err.splitlines()
        assert re.search(message, line)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("none.json", "--output", "out.ply"), "does not exist"),
        (("plane.json", "--output", "out.ply"), "a plane must be cut by a solid"),
        (("plane.json", "--output", "out.step"), "output must end in one of .glb"),
        (("plane.json", "--output", "-"), "output must end in one of .glb"),
        (("plane.json", "--output", "none/out.ply"), "a folder that is there"),
        (("ball.json", "--output", "out.ply", "--tolerance", "0"), "tolerance must be"),
        (("ball.json", "--output", "out.ply", "--scale", "-1"), "scale must be"),
        (("ball.json", "--output", "out.ply", "--tolerance", "1e-15"), "be larger"),
    ],
)  # fmt: skip
def test_what_cannot_be_exported_is_told_on_a_line(
    arguments, message, tmp_path, call, capfd, monkeypatch
):
    plane = {"type": "plane", "point": [0, 0, 1], "normal": [0, 0, 1]}
    ball = {"type": "sphere", "center": [0, 0, 1], "radius": 0.5}
    for name, shape in (("plane", plane), ("ball", ball)):
        record = {"version": 1, "shapes": [shape]}
        (tmp_path / f"{name}.json").write_text(json.dumps(record))
    monkeypatch.chdir(tmp_path)
    assert call("export", *arguments) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert message in line
    assert {entry.name for entry in tmp_path.iterdir()} == {"plane.json", "ball.json"}


@RELEASE
def test_stems_of_a_scan_are_fitted_and_found(tmp_path, call, capfd):
    scanner = {
        "model": "spherical",
        "elevation_deg": {"first": 24, "last": -24, "count": 96},
        "azimuth_deg": {"first": -180, "last": 179.25, "count": 480},
    }
    path, output = tmp_path / "scanner.json", tmp_path / "scan"
    path.write_text(json.dumps(scanner))
    stem = ("--center", 1, 0, -3, "--axis", 0.05, 1, 0, "--radius", 0.3, "--height", 5)
    assert call("render", "--camera", path, *stem, "--output", output) == 0
    for command, file in (("fit", "fit.json"), ("find", "found.json")):
        given = output / "depth.tiff", "--camera", path, "--sigma", 0.002
        page = tmp_path / f"{command}.html"
        code = call(command, *given, "--output", tmp_path / command, "--page", page)
        assert code == 0, capfd.readouterr().err
        record = json.loads((tmp_path / command / file).read_text())
        one = record if command == "fit" else record["cylinders"][0]
        assert one["radius_m"] == pytest.approx(0.3, abs=1e-4)
        assert page.stat().st_size > 1e5
