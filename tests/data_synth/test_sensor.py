"""The noise of a dataset is that of its sensor model."""

import dataclasses

import cv2
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from data_synth.distribution import Fixed
from impostor_jax.io.dataset import read_dataset, read_manifest, sensor_of
from impostor_jax.io.sensor_record import sensor_record
from impostor_jax.sensor.base import cos_incidence
from tests.data_synth.small import COUNT, SMALL, small_dataset
from tests.groups import DATASETS, FULL

pytestmark = DATASETS


def pairs(folder):
    """Readings and clean depths of all images, in meters."""
    found = []
    for number, image in enumerate(read_dataset(folder)):
        scene, _, name = image.key.partition("_")
        path = folder / "train" / scene / "depth_clean" / f"{name}.png"
        found.append((image, 1e-4 * cv2.imread(str(path), -1)))
        assert number < COUNT
    return found


@FULL
def test_standardized_noise_is_normal(tmp_path):
    preset = dataclasses.replace(
        SMALL, sensor=ij.StructuredLight(), projector_baseline=None, wall=Fixed(1.5)
    )
    small_dataset(tmp_path, preset, normals=True)
    sensor, values = sensor_of(read_manifest(tmp_path)), []
    for image, clean in pairs(tmp_path):
        scene, _, name = image.key.partition("_")
        path = tmp_path / "train" / scene / "normal" / f"{name}.png"
        normal = (cv2.imread(str(path))[..., ::-1] / 127.5 - 1).astype(np.float32)
        cosine = cos_incidence(jnp.asarray(normal), image.camera)
        sigma = np.asarray(sensor.sigma(jnp.asarray(clean, jnp.float32), cosine))
        values.append(((image.depth - clean) / sigma)[clean > 0])
    values = np.concatenate(values)
    assert len(values) > 20000
    # Three deviations of mean and variance of so many; rounding to 0.1 mm adds 0.2 %.
    assert abs(values.mean()) < 3 / np.sqrt(len(values))
    assert abs(values.std() - 1) < 3 / np.sqrt(2 * len(values)) + 0.004
    within = np.mean(np.abs(values) < 1.959964)
    assert abs(within - 0.95) < 3 * np.sqrt(0.95 * 0.05 / len(values))


@FULL
def test_dropout_misses_its_share(tmp_path):
    sensor = ij.Dropout(ij.ConstantNoise(0.001), rate=0.2, cutoff=np.radians(89.0))
    preset = dataclasses.replace(SMALL, sensor=sensor, projector_baseline=None)
    small_dataset(tmp_path, preset)
    missing = np.concatenate([(i.depth == 0)[c > 0] for i, c in pairs(tmp_path)])
    assert abs(missing.mean() - 0.2) < 4 * np.sqrt(0.2 * 0.8 / len(missing))


@FULL
def test_the_projector_leaves_shadows_beside_the_cans(tmp_path):
    preset = dataclasses.replace(SMALL, sensor=ij.ConstantNoise(0.001))
    small_dataset(tmp_path / "with", preset)
    bare = dataclasses.replace(preset, projector_baseline=None)
    small_dataset(tmp_path / "without", bare)
    aside = []
    for (image, clean), (other, _) in zip(
        pairs(tmp_path / "with"), pairs(tmp_path / "without"), strict=True
    ):
        shadow = (image.depth == 0) & (clean > 0)
        assert 0 < shadow.mean() < 0.2
        assert not ((other.depth == 0) & (clean > 0)).any()
        np.testing.assert_array_equal(image.depth[~shadow], other.depth[~shadow])
        covered = image.mask.any(axis=0)
        aside.append(np.nonzero(shadow)[1].mean() - np.nonzero(covered)[1].mean())
    # The projector stands on the right, so shadows fall to the left.
    assert np.mean(aside) < -1


@FULL
def test_a_sensor_of_its_own_replaces_the_preset_s(tmp_path):
    own = ij.CorrelatedNoise(ij.ConstantNoise(0.001), 0.002, 5.0)
    small_dataset(tmp_path, sensor=own, count=1)
    assert sensor_record(sensor_of(read_manifest(tmp_path))) == sensor_record(own)


def test_a_sensor_that_is_none_is_refused(tmp_path):
    with pytest.raises(ValueError, match="sensor must be a noise model"):
        small_dataset(tmp_path / "out", sensor=0.001)
    assert not (tmp_path / "out").exists()


def test_the_clean_depth_does_not_depend_on_the_sensor(tmp_path, bop):
    small_dataset(tmp_path, dataclasses.replace(SMALL, sensor=ij.ConstantNoise(0.01)))
    for (_, one), (_, other) in zip(pairs(tmp_path), pairs(bop), strict=True):
        np.testing.assert_array_equal(one, other)
