import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.fit.ball import Ball
from impostor_jax.fit.parameterization import Chart
from impostor_jax.fit.round_body import CylinderBody, FrustumBody, RoundBody
from impostor_jax.numerics import eps
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.sphere import Sphere
from tests.fit.scenes import can

BODIES = {
    "cylinder": lambda: CylinderBody.of(can()),
    "frustum": lambda: FrustumBody.of(
        Frustum((0.0, -0.05, 0.3), (0.02, 0.06, 0.4), 0.03, 0.05)
    ),
    "sphere": lambda: Ball.of(Sphere((0.01, 0.02, 0.4), 0.05)),
}


@pytest.fixture(params=BODIES)
def make(request):
    return BODIES[request.param]


def chart(body, fixed=()):
    return Chart.around(body, jnp.asarray(1e-3), jnp.asarray(2e-3), fixed)


def test_zero_is_the_reference(make, dtype):
    body = make()
    around = chart(body)
    moved = around.body(jnp.zeros(around.size))
    for one, other in zip(jax.tree.leaves(moved), jax.tree.leaves(body), strict=True):
        np.testing.assert_allclose(one, other, rtol=eps(dtype, 4))


def test_any_vector_gives_a_body(make):
    body = make()
    around = chart(body)
    vector = jnp.asarray([90.0, -300, 5, 7, -200, 300, -400, 500][: around.size])
    moved = around.body(vector)
    assert float(moved.radius) > 0
    if isinstance(body, RoundBody):
        assert float(moved.height) > 0
        assert float(jnp.linalg.norm(moved.axis)) == pytest.approx(1, abs=1e-6)
    if isinstance(body, FrustumBody):
        assert float(moved.radius1) >= 0
        assert float(moved.radius2) >= 0


@pytest.mark.parametrize("kind", ["cylinder", "frustum"])
def test_an_end_moves_alone_and_along_the_wall(kind, dtype):
    body = BODIES[kind]()
    around = chart(body)
    moved = around.body(jnp.zeros(around.size, dtype).at[-1].set(0.5))
    low = body.center - body.axis * body.height / 2
    found = moved.center - moved.axis * moved.height / 2
    # The height is an exponential: to first order in 1 mm of 120.
    np.testing.assert_allclose(found, low, atol=1e-5)
    assert float(moved.height - body.height) == pytest.approx(0.001, abs=1e-5)
    assert float(moved.slope) == pytest.approx(float(body.slope), abs=1e-6)
    growth = float(body.slope) * float(moved.height - body.height) / 2
    assert float(moved.radius - body.radius) == pytest.approx(
        growth, rel=0.01, abs=1e-8
    )


@pytest.mark.parametrize(
    ("kind", "fixed", "size"),
    [
        ("cylinder", (), 7),
        ("cylinder", ("radius",), 6),
        ("cylinder", ("height",), 6),
        ("cylinder", ("axis",), 5),
        ("cylinder", ("center",), 4),
        ("cylinder", ("center", "height"), 3),
        ("cylinder", ("center", "axis", "radius"), 1),
        ("frustum", (), 8),
        ("frustum", ("radius1",), 7),
        ("frustum", ("radius2", "height"), 6),
        ("frustum", ("radius1", "radius2"), 6),
        ("frustum", ("center", "axis", "height"), 2),
        ("sphere", (), 4),
        ("sphere", ("radius",), 3),
        ("sphere", ("center",), 1),
    ],
)
def test_held_parameters_do_not_move(kind, fixed, size, dtype):
    body = BODIES[kind]()
    held = chart(body, fixed)
    assert held.size == size
    moved = held.body(jnp.arange(1.0, size + 1))
    for name in ("center", "axis", "radius", "radius1", "radius2", "height"):
        if (name == "radius" and kind == "frustum") or not hasattr(body, name):
            continue
        same = np.allclose(getattr(moved, name), getattr(body, name), rtol=1e-6)
        assert same == (name in fixed), name


@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("kind", BODIES)
def test_the_numbers_that_move_are_those_with_a_derivative(kind):
    body = BODIES[kind]()
    radii = body.names_of_radii if isinstance(body, RoundBody) else ("radius",)
    names = ("center", *radii)
    names += ("axis", "height") if isinstance(body, RoundBody) else ()
    for count in {0, 1, min(2, len(names) - 1), len(names) - 1}:
        for fixed in itertools.combinations(names, count):
            held = chart(body, fixed)
            still = jnp.zeros(held.size)
            change = jax.jacfwd(lambda v, held=held: held.body(v).numbers)(still)
            moves = np.abs(np.asarray(change)).max(axis=1) > 0
            assert tuple(np.flatnonzero(moves)) == body.moving(fixed), fixed


@pytest.mark.usefixtures("double")
def test_tangent_is_the_derivative_at_zero(make):
    body = make()
    around = chart(body)
    derivative = jax.jacfwd(lambda v: around.body(v).numbers)(jnp.zeros(around.size))
    found = around.natural() @ around.scale
    np.testing.assert_allclose(found, derivative, atol=1e-12)
