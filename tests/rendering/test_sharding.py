"""A batch that is spread over several devices is rendered where it lies."""

import os
import subprocess
import sys

PROGRAM = """
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec

import impostor_jax as ij

camera = ij.PinholeCamera(80.0, 80.0, 31.5, 23.5, 64, 48)
z = jnp.linspace(0.8, 1.5, 8)
zero, one = jnp.zeros_like(z), jnp.ones_like(z)
cylinders = ij.Cylinder(
    jnp.stack([zero, zero, z], -1), jnp.stack([z, one, zero], -1), 0.1 * one, 0.3 * one
)


def depth(cylinder):
    return ij.render(cylinder, camera, ("depth",)).depth


def loss(cylinder):
    seen = depth(cylinder)
    return jnp.sum(jnp.where(jnp.isfinite(seen), seen, 0))


mesh = jax.make_mesh((4,), ("batch",), (jax.sharding.AxisType.Auto,))
spread = jax.device_put(cylinders, NamedSharding(mesh, PartitionSpec("batch")))
for function in (depth, loss, jax.grad(loss)):
    run = jax.jit(jax.vmap(function))
    for whole, parts in zip(
        jax.tree.leaves(run(cylinders)), jax.tree.leaves(run(spread)), strict=True
    ):
        assert len(parts.sharding.device_set) == 4, parts.sharding
        assert parts.addressable_shards[0].data.shape[0] == 2
        np.testing.assert_allclose(whole, parts, rtol=1e-5, atol=1e-6)
    text = run.lower(spread).compile().as_text()
    # But for whether a loop has ended (`computed_apart`), one flag of all.
    for exchange in ("all-gather", "all-to-all", "collective-permute"):
        assert exchange not in text, exchange
"""


def test_renders_and_gradients_stay_on_four_devices_and_exchange_no_image():
    flags = "--xla_force_host_platform_device_count=4"
    environment = os.environ | {"XLA_FLAGS": f"{os.environ['XLA_FLAGS']} {flags}"}
    found = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=environment,
        capture_output=True,
        text=True,
    )
    assert found.returncode == 0, found.stderr
