"""Records of fits and searches: their schemas, their poses and their versions."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.fittable import KINDS, no_guess
from impostor_jax.fit.pose import pose_from_camera, pose_of
from impostor_jax.io.record import found_record, shape_of_fit
from tests.fit.scenes import CAMERA, SIGMA, can, image, image_of
from tests.groups import SMALL_IMAGES
from tests.schemas import validator

AXIS = np.array([0.3, 0.8, 0.52]) / np.linalg.norm([0.3, 0.8, 0.52])
CENTER = np.array([0.01, 0.02, 0.4])
SHAPES = {
    "cylinder": ij.Cylinder(CENTER, AXIS, 0.04, 0.12),
    "frustum": ij.Frustum(CENTER - 0.06 * AXIS, CENTER + 0.06 * AXIS, 0.05, 0.03),
    "sphere": ij.Sphere(CENTER, 0.05),
    "tube": ij.tube(CENTER, AXIS, 0.05, 0.04, 0.12),
}
FITS = {
    "cylinder": ij.fit_cylinder,
    "frustum": ij.fit_frustum,
    "sphere": ij.fit_sphere,
    "tube": ij.fit_tube,
}


FIT, FOUND = validator("fit"), validator("found")


def written(record):
    """As a file has it, which takes no NaN."""
    return json.loads(json.dumps(record, allow_nan=False))


def failed(shape):
    kinds = {kind.__name__.lower(): fittable for kind, fittable in KINDS.items()}
    kind = kinds["solid" if shape == "tube" else shape]
    return no_guess(kind, np.zeros((4, 5), bool))


@pytest.mark.parametrize("shape", SHAPES)
def test_the_frame_of_a_shape_is_at_its_center_along_its_axis(shape, dtype):
    pose = pose_of(jax.tree.map(lambda x: jnp.asarray(x, dtype), SHAPES[shape]))
    assert pose.dtype == dtype
    np.testing.assert_allclose(pose[:3, 3], CENTER, atol=1e-7)
    np.testing.assert_array_equal(pose[3], [0, 0, 0, 1])
    rotation = np.asarray(pose[:3, :3], float)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(rotation) > 0
    expected = [0, 0, 1] if shape == "sphere" else AXIS
    np.testing.assert_allclose(rotation[:, 2], expected, atol=1e-6)


def test_frames_of_a_batch_are_those_of_its_shapes():
    batch = jax.tree.map(lambda *x: jnp.stack(x), can(60.0), can(20.0))
    expected = np.stack([pose_of(can(60.0)), pose_of(can(20.0))])
    np.testing.assert_array_equal(pose_of(batch), expected)


def test_a_shape_without_a_frame_is_refused():
    with pytest.raises(ValueError, match="solid must be a tube"):
        pose_of(ij.Plane((0, 0, 1), (0, 0, -1)))


def test_pose_in_the_camera_is_that_of_the_moved_shape():
    turn = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    camera_from_world = ij.RigidTransform(turn, (0.1, 0.2, 0.3))
    found = pose_from_camera(pose_of(SHAPES["cylinder"]), camera_from_world)
    moved = SHAPES["cylinder"].transformed(camera_from_world)
    np.testing.assert_allclose(found[:3, 2], moved.axis, atol=1e-6)
    np.testing.assert_allclose(found[:3, 3], moved.center, atol=1e-6)
    pose = pose_of(SHAPES["cylinder"])
    np.testing.assert_array_equal(pose_from_camera(pose, None), pose)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_failed_fit_has_a_record_of_the_same_keys(shape):
    record = written(failed(shape).to_dict())
    FIT.validate(record)
    assert (record["version"], record["shape"]) == (1, shape)
    assert record["success"] is False
    assert record["seconds"] is record["taper"] is record["bore"] is None
    kept = dataclasses.replace(failed(shape), shape=SHAPES[shape])
    FIT.validate(written(kept.to_dict()))


@SMALL_IMAGES
@pytest.mark.parametrize("shape", SHAPES)
def test_a_fit_has_a_record_that_its_schema_knows(shape):
    depth, mask = image_of(SHAPES[shape])
    fit = FITS[shape](depth, CAMERA, mask, SIGMA)
    record = written(fit.to_dict(seconds=0.5))
    FIT.validate(record)
    assert record["success"] is True
    assert record["seconds"] == 0.5
    pose = np.array(record["world_from_object"])
    np.testing.assert_allclose(pose[:3, 3], CENTER, atol=0.002)
    np.testing.assert_array_equal(fit.pose_in_camera, fit.pose)
    back = shape_of_fit(record, "fit")
    np.testing.assert_allclose(pose_of(back), pose, atol=1e-5)


@SMALL_IMAGES
def test_tests_of_a_can_are_in_its_record():
    depth, mask = image()
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    record = written(fit.to_dict(0.1, ij.test_taper(fit), ij.test_bore(fit)))
    FIT.validate(record)
    assert record["taper"]["frustum_status"] == "converged"
    assert "outer_radius_m" in record["bore"]


@SMALL_IMAGES
def test_a_stacked_fit_holds_no_camera():
    depth, mask = image()
    fits = ij.fit_cylinders(np.stack([depth] * 2), CAMERA, [mask] * 2, SIGMA)
    assert fits.pose.shape == (2, 4, 4)
    with pytest.raises(AttributeError, match=r"multiply fit\.pose by the camera's"):
        _ = fits.pose_in_camera


GOOD = written(dataclasses.replace(failed("tube"), shape=SHAPES["tube"]).to_dict())


@pytest.mark.parametrize(
    "change",
    [
        {"version": 2},
        {"shape": "cylinder"},
        {"shape": "knot"},
        {"source": "hearsay"},
        {"status": "fine"},
        {"success": "yes"},
        {"world_from_object": np.eye(3).tolist()},
        {"axis": [0, 1]},
        {"axis": None},
        {"outer_radius_m": "wide"},
        {"radius_m": 0.1},
        {"std": {}},
        {"std": GOOD["std"] | {"radius_m": 0.1}},
        {"std_budget": {"luck": GOOD["std"]}},
        {"alternatives": [{"weight": 0.5}]},
        {"num_pixels": -1},
        {"num_pixels": 1.5},
        {"taper": {"needed": True}},
        {"seconds": "long"},
        {"unknown": 1},
    ],
    ids=str,
)
def test_the_schema_refuses_wrong_records(change):
    assert FIT.is_valid(GOOD)
    assert not FIT.is_valid(GOOD | change)


@pytest.mark.parametrize("key", GOOD)
def test_the_schema_needs_every_key(key):
    assert not FIT.is_valid({k: v for k, v in GOOD.items() if k != key})


def test_the_schemas_know_every_status():
    for schema in (FIT.schema, FOUND.schema):
        assert schema["$defs"]["status"]["enum"] == [str(s) for s in ij.FitStatus]


@SMALL_IMAGES
def test_a_search_has_a_record_that_its_schema_knows():
    depth, _ = image()
    found = ij.find_cylinders(depth, CAMERA, sigma=SIGMA)
    record = written(found_record(found, CAMERA, 0.5))
    FOUND.validate(record)
    (cylinder,) = record["cylinders"]
    np.testing.assert_array_equal(cylinder["world_from_cylinder"], found[0].pose)
    assert found.to_dict()["cylinders"] == record["cylinders"]
    assert [fit.status for fit in found] == list(found.statuses)
    assert found.reasons == tuple(fit.reason for fit in found.fits)
    for change in ({"version": 2}, {"cylinders": [{}]}, {"planes": None}, {"a": 1}):
        assert not FOUND.is_valid(record | change)
    assert not FOUND.is_valid(record | {"cylinders": [cylinder | {"std": None}]})


def test_a_record_of_a_newer_version_is_refused():
    record = GOOD | {"success": True}
    assert isinstance(shape_of_fit(record, "fit"), ij.Solid)
    # Version 0.1 wrote none.
    old = {key: value for key, value in record.items() if key != "version"}
    assert isinstance(shape_of_fit(old, "fit"), ij.Solid)
    with pytest.raises(
        ValueError, match=r"version of fit must be at most 1, got 2: it"
    ):
        shape_of_fit(record | {"version": 2}, "fit")
    with pytest.raises(ValueError, match="version of fit must be a whole number"):
        shape_of_fit(record | {"version": "new"}, "fit")
