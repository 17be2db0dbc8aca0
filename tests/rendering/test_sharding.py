"""A batch that is spread over devices, of one process or of two, is rendered there."""

import os
import socket
import subprocess
import sys

import pytest

from tests.groups import FULL, RELEASE

# Arguments: number of processes, which of them, and where they meet.
PROGRAM = """
import sys

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec

import impostor_jax as ij

count, number, address = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
if count > 1:
    jax.config.update("jax_cpu_collectives_implementation", "gloo")
    jax.distributed.initialize(address, count, number)
assert len(jax.devices()) == 4
assert len(jax.local_devices()) == 4 // count

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
sharding = NamedSharding(mesh, PartitionSpec("batch"))


def spread_out(x):
    x = np.asarray(x)
    return jax.make_array_from_callback(x.shape, sharding, lambda index: x[index])


spread = jax.tree.map(spread_out, cylinders)
for function in (depth, loss, jax.grad(loss)):
    run = jax.jit(jax.vmap(function))
    for whole, parts in zip(
        jax.tree.leaves(run(cylinders)), jax.tree.leaves(run(spread)), strict=True
    ):
        assert len(parts.sharding.device_set) == 4, parts.sharding
        assert len(parts.addressable_shards) == 4 // count
        for part in parts.addressable_shards:
            assert part.data.shape[0] == 2
            np.testing.assert_allclose(
                whole[part.index], part.data, rtol=1e-5, atol=1e-6
            )
    text = run.lower(spread).compile().as_text()
    # But for whether a loop has ended (`computed_apart`), one flag of all.
    for exchange in ("all-gather", "all-to-all", "collective-permute"):
        assert exchange not in text, exchange
"""


@FULL
@pytest.mark.parametrize("count", [pytest.param(1, marks=RELEASE), 2])
def test_renders_and_gradients_stay_on_four_devices_and_exchange_no_image(count):
    flags = f"--xla_force_host_platform_device_count={4 // count}"
    environment = os.environ | {"XLA_FLAGS": f"{os.environ['XLA_FLAGS']} {flags}"}
    with socket.socket() as free:
        free.bind(("localhost", 0))
        address = f"localhost:{free.getsockname()[1]}"
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", PROGRAM, str(count), str(number), address],
            env=environment,
            stderr=subprocess.PIPE,
            text=True,
        )
        for number in range(count)
    ]
    errors = [process.communicate()[1] for process in processes]
    assert [process.returncode for process in processes] == [0] * count, errors
