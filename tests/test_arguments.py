"""Numbers that no computation can hold are refused by name, before it begins."""

import subprocess
import sys
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.arguments import users_level
from impostor_jax.fit.request import checked_depth, checked_mask, checked_prior

SETTINGS = {"fx": 60.0, "fy": 62.0, "cx": 31.5, "cy": 23.0, "width": 64, "height": 48}
CAN = {"center": (0, 0, 1.0), "axis": (0, 1.0, 0), "radius": 0.1, "height": 0.2}
NAMES = ("center", "axis", "radius", "height")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fx": 1e300}, "fx must be a positive number in pixels, from .* got 1e"),
        ({"fy": 1e-30}, "fy must be a positive number in pixels, from .* got 1e-30"),
        ({"cx": -1e25}, "cx must be a finite number in pixels, from .* got -1e"),
        ({"width": 10**12}, "width and height must be at most 268435456 pixels toge"),
        ({"width": 10**30}, "width and height must be at most 268435456 pixels toge"),
        ({"width": 30000, "height": 30000}, "got 30000 x 30000"),
    ],
)
@pytest.mark.parametrize("kind", [ij.PinholeCamera, ij.OrthographicCamera])
def test_camera_out_of_range_is_refused(kind, change, message):
    with pytest.raises(ValueError, match=message.replace("pixels, ", "pixels.*")):
        kind(**SETTINGS | change)


def test_large_cameras_are_made():
    assert ij.PinholeCamera(**SETTINGS | {"width": 2**14, "height": 2**14}).width


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radius": 1e30}, "radius must be meters of at most 1.84e.19 in float32"),
        ({"radius": 1e300}, "radius must be meters of at most 1.84e.19 in float32"),
        ({"height": 1e20}, "height must be meters of at most .* got 1e.20"),
        ({"center": (0, -1e30, 1)}, "center must be meters of at most .* got 1e.30"),
        ({"axis": (0, 1e300, 0)}, "axis must be numbers of at most 3.4e.38 in float32"),
    ],
)
def test_shape_out_of_range_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        ij.Cylinder(**CAN | change)
    if "radius" in change:
        with pytest.raises(ValueError, match=message):
            ij.Sphere((0, 0, 1), change["radius"])


@pytest.mark.usefixtures("double")
def test_range_is_that_of_the_type():
    assert ij.Sphere((0, 0, 1), 1e30).radius == 1e30
    single = jnp.asarray([0, 0, 1e30], jnp.float32)
    with pytest.raises(ValueError, match="in float32"):
        ij.Sphere(single, jnp.asarray(1, jnp.float32))
    with pytest.raises(ValueError, match=r"at most 1\.34e\+154 in float64"):
        ij.Sphere((0, 0, 1), 1e200)


def test_what_is_traced_passes():
    radius = jax.jit(lambda r: ij.Sphere(jnp.zeros(3), r).radius)(jnp.asarray(1e30))
    assert radius == np.float32(1e30)


def test_argument_of_another_type_is_refused_without_the_type_checker():
    # The annotations refuse these in every other test.
    program = """
import numpy as np, impostor_jax as ij
camera = ij.PinholeCamera(150, 150, 15.5, 11.5, 32, 24)
can = ij.Cylinder((0, 0, 1), (0, 1, 0), 0.1, 0.2)
pipe = ij.Tube((0, 0, 1), (0, 1, 0), 0.1, 0.08, 0.2)
depth = np.ones((24, 32))
for call in (
    lambda: ij.render([can, can], camera),
    lambda: ij.render(pipe, camera),
    lambda: ij.Scene([can, pipe]),
    lambda: ij.union(can, pipe),
    lambda: ij.render(can, "kinect"),
    lambda: ij.fit_cylinder(depth, "kinect"),
    lambda: ij.fit_cylinders(depth[None], "kinect"),
    lambda: ij.fit_cylinder(depth, camera, initial="can"),
    lambda: ij.fit_cylinders(depth[None], camera, initial="can"),
    lambda: ij.fit_cylinder(depth, camera, mask_meaning="edge"),
    lambda: ij.fit_cylinder(depth, camera, scale="free"),
    lambda: ij.fit_cylinder(depth, camera, errors="white"),
    lambda: ij.fit_cylinder(depth, camera, prior=[("radius", 0.04, 0.001)]),
    lambda: ij.fit_cylinders(depth[None], camera, prior=["radius"]),
    lambda: ij.fit_cylinder(depth, camera, prior="radius"),
    lambda: ij.trace([can], camera, []),
    lambda: ij.trace(can, "kinect", []),
    lambda: ij.trace(can, camera, ij.AmbientLight(1.0)),
    lambda: ij.trace(can, camera, ["lamp"]),
    lambda: ij.trace(can, camera, [], "red"),
    lambda: ij.trace(can, camera, [], depth=1.5),
    lambda: ij.trace(can, camera, [], background="sky"),
    lambda: ij.trace(can, camera, [], effort=3),
):
    try:
        call()
    except ValueError as error:
        print(error)
"""
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    prior = (
        "prior must map names to a value and a standard deviation, as in "
        "{'radius': (0.04, 0.001)}, got "
    )
    kinect = (
        "the text 'kinect'; ij.camera_from makes one of a matrix K, or of another "
        "program's"
    )
    pipe = "Tube, whose shape is its attribute solid"
    assert found.stdout.splitlines() == [
        "primitive must be a shape, or an ij.Scene of a list of shapes, got list",
        "primitive must be a shape, or an ij.Scene of a list of shapes, got " + pipe,
        "shapes must be primitives, single ones or batches (n,), got " + pipe,
        "shapes must be primitives, single ones or batches (n,), got " + pipe,
        "camera must be a camera, such as an ij.PinholeCamera, got " + kinect,
        "camera must be a PinholeCamera or a SphericalCamera, got " + kinect,
        "camera must be a PinholeCamera or a SphericalCamera, got " + kinect,
        "initial must be one Cylinder, got 'can'",
        "initial must be a batch of 1 cylinders, got 'can'",
        "mask_meaning must be one of region, outline; got 'edge'",
        "scale must be one of estimated, fixed; got 'free'",
        "errors must be one of independent, correlated; got 'white'",
        prior + "[('radius', 0.04, 0.001)]",
        prior + "['radius']",
        prior + "'radius'",
        "scene must be an ij.Scene or a shape, got list",
        "camera must be a camera, such as an ij.PinholeCamera, got " + kinect,
        "lights must be a sequence of lights, got AmbientLight",
        "lights must be lights, such as ij.PointLight, got 'lamp'",
        "materials must be ij.Material, got str",
        "depth must be a whole number from 0 to 16 bounces, got 1.5",
        "background must be numbers of shape (3,), got <U3 of shape ()",
        "effort must be an Effort or one of fast, balanced, exact, got 3",
    ]


@pytest.mark.parametrize(
    ("prior", "message"),
    [
        ({"radius": 0.04}, r"prior\['radius'\] must be a value and a standard dev"),
        ({"radius": (1e300, 1.0)}, r"prior\['radius'\] must be .* got 1e\+300"),
        ({"radius": (0.04, 1e300)}, r"deviation of prior\['radius'\] must be"),
        ({"center": ((0, 0, 1), (0.1, 0.1, 0.1))}, r"\['center'\] must be one number"),
        ({"center": ((0, 0, 1e300), 1.0)}, r"prior\['center'\] must be numbers of at"),
    ],
)
def test_prior_out_of_range_is_refused(prior, message):
    with pytest.raises(ValueError, match=message):
        checked_prior(prior, NAMES, None)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_depth_beyond_all_range_is_refused(dtype):
    camera = ij.PinholeCamera(**SETTINGS)
    depth = np.ones((48, 64), dtype)
    far = 1e300 if dtype == np.float64 else 1e30
    depth[3, 4] = far
    with pytest.raises(
        ValueError, match=r"depth must be at most 1\.84e\+19 m.* got 1e\+30"
    ):
        checked_depth(depth, camera)
    depth[5, 6] = np.nan
    with pytest.raises(ValueError, match="missing readings are 0, NaN or infinity"):
        checked_depth(depth, camera)
    depth[3, 4] = np.inf
    assert checked_depth(depth, camera).sum() == 48 * 64 - 2
    # A sum that is out of range is none of the readings.
    assert np.isfinite(checked_depth(np.full((48, 64), 1e17, dtype), camera)).all()
    assert (checked_depth(np.full((48, 64), 1e3, np.float16), camera) == 1e3).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_65535_millimeters_are_no_reading(dtype):
    units = np.full((48, 64), 65535, np.uint16)
    units[3, 4] = 65534
    depth = checked_depth(units * dtype(0.001), ij.PinholeCamera(**SETTINGS))
    assert depth[3, 4] == pytest.approx(65.534)
    assert np.count_nonzero(depth) == 1


@pytest.mark.usefixtures("double")
def test_depth_of_double_precision_may_be_larger():
    depth = np.full((48, 64), 1e30)
    assert checked_depth(depth, ij.PinholeCamera(**SETTINGS))[0, 0] == 1e30


def test_a_warning_names_the_line_that_called_the_package():
    inside = {"__name__": "impostor_jax.inside", "warnings": warnings}
    inside["users_level"] = users_level
    exec(
        "def deep(): warnings.warn('told', stacklevel=users_level())\n"
        "def shallow(): deep()",
        inside,
    )
    with pytest.warns(UserWarning, match="told") as told:
        inside["shallow"]()
    assert told[0].filename == __file__


def test_a_mask_has_no_negative_values():
    mask = np.where(np.arange(64)[None] < 30, -1, 0) * np.ones((48, 1), int)
    with pytest.raises(ValueError, match="positive where it is, got -1"):
        checked_mask(mask, ij.PinholeCamera(**SETTINGS))
