"""Fits go to the processor where JAX would take a graphics card."""

import os
import subprocess
import sys

import jax
import pytest

from impostor_jax import device
from impostor_jax.fit.threads import side_by_side
from tests.groups import RELEASE


@pytest.fixture
def card(monkeypatch):
    """JAX's default is taken for a card; the processor beside it."""
    monkeypatch.setattr(device, "is_processor", lambda: False)
    return jax.devices("cpu")[0]


@device.on_processor
def place(_):
    return device.asked()


def test_default_device_is_where_arrays_are_made():
    assert device.where() == next(iter(jax.numpy.zeros(()).devices()))
    assert device.is_processor()
    assert place(1.0) is None


def test_a_platform_may_be_asked_for_by_its_name():
    with jax.default_device("cpu"):
        assert device.where() == jax.devices("cpu")[0]


def test_concrete_call_leaves_a_card_for_the_processor(card):
    assert place(jax.numpy.zeros(3)) == card
    assert device.asked() is None


def test_traced_call_stays_where_jax_puts_it(card):
    placed = []
    jax.jit(lambda x: placed.append(place(x)))(1.0)
    assert placed == [None]


def test_what_the_user_asks_for_is_kept(card):
    with jax.default_device("cpu"):
        assert place(1.0) == "cpu"


def test_call_stays_where_there_is_no_processor(card, monkeypatch):
    def refuse(**_):
        raise RuntimeError("Unknown backend cpu")

    monkeypatch.setattr(jax, "local_devices", refuse)
    assert place(1.0) is None


def test_threads_work_where_the_caller_does():
    with jax.default_device("cpu"):
        assert side_by_side(lambda _: device.asked(), range(3)) == ["cpu"] * 3


# The first of two processors is taken for a card.
PROGRAM = """
import jax
import jax.numpy as jnp
import numpy as np

import impostor_jax as ij
from impostor_jax import device

card, processor = jax.devices()
device.is_processor = lambda: device.where() == processor
device._processor = lambda: processor

numbers = 131.25, 131.25, 79.5, 59.5, 160, 120
camera = ij.PinholeCamera(*numbers)
can = ij.Cylinder((0.0, 0.0, 0.8), (0.3, 0.8, 0.52), 0.04, 0.12)
still = ij.RigidTransform(jnp.eye(3), jnp.zeros(3))
posed = ij.PinholeCamera(*numbers, camera_from_world=still)
scene = ij.Scene([can, ij.Plane((0.0, 0.0, 1.2), (0.0, 0.0, -1.0))])
maps = ij.render(scene, camera, ("depth", "index"))
assert maps.depth.devices() == {card}
noise = np.random.default_rng(0).normal(0, 0.001, maps.depth.shape)
depth, mask = maps.depth + jnp.asarray(noise, maps.depth.dtype), maps.index == 0


def check(*results):
    for leaf in jax.tree.leaves(results):
        if isinstance(leaf, jax.Array):
            assert leaf.devices() == {processor}
            # It may meet what lies on the card.
            assert not leaf.committed


fit = ij.fit_cylinder(depth, camera, mask, 0.001)
assert fit.success
tied = (jax.device_put(x, card) for x in (depth, mask))
fits = ij.fit_cylinders(jnp.stack([depth] * 2), camera, [mask] * 2, 0.001)
check(
    fit,
    ij.fit_cylinder(depth, camera, mask, 0.001, initial=can),
    ij.fit_cylinder(next(tied), camera, next(tied), 0.001),
    ij.fit_cylinder(
        depth,
        jax.device_put(posed, card),
        mask,
        jax.device_put(ij.StructuredLight(), card),
        initial=jax.device_put(can, card),
        prior={"height": (jax.device_put(jnp.array(0.12), card), 0.01)},
    ),
    fits,
    fits[1],
)
tracker = ij.Tracker(camera, sigma=0.001)
tracks = [tracker.step(depth) for _ in range(2)][-1]
check([track.cylinder for track in tracks])
assert len(tracks) == 1
assert ij.render(fit.cylinder, camera, ("depth",)).depth.devices() == {card}
"""


@RELEASE
def test_all_of_a_fit_and_of_a_track_stays_on_the_processor():
    flags = f"{os.environ['XLA_FLAGS']} --xla_force_host_platform_device_count=2"
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"},
        stderr=subprocess.PIPE,
        text=True,
    )
    assert not done.returncode, done.stderr
