"""Whether the readings of a cylinder need a bore: a test by the likelihood ratio.

A cylinder is the tube without a bore. The tube is fitted, and twice the logarithm of
the ratio of the likelihoods is the statistic: of each reading that is normal about the
surface or an outlier, and of pixels beside that see through what a cylinder would hide.
Errors that readings share, and residuals larger than the noise, divide it.

No bore is the end of what an inner radius may be, not a place within. So the statistic
is not chi-squared with one degree of freedom there but 0 in half of the cases and that
in the others (Self and Liang), and the p-value is half as large. In truth it is 0 far
more often: a bore must be a pixel wide to be seen, and a reading of a lid in it 30 or
more half-chords of its wall off. Of full cans fewer than the level are taken for tubes.

References:
    Self and Liang, Asymptotic properties of maximum likelihood estimators and
    likelihood ratio tests under nonstandard conditions, JASA 1987.
"""

__all__ = ["BoreTest", "test_bore"]

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.arguments import working_precision
from impostor_jax.camera.base import posed as posed_at
from impostor_jax.compiling import quickly_compiled
from impostor_jax.device import on_processor
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.evidence import readings_of
from impostor_jax.fit.fittable import CYLINDER, TUBE, Fittable
from impostor_jax.fit.posterior import cost_of, hidden_pixels
from impostor_jax.fit.problem import Inputs, posed
from impostor_jax.fit.request import (
    FitRequest,
    checked_noise,
    checked_prior,
    checked_settings,
    request_of_cylinder,
)
from impostor_jax.fit.result import Fit, PoseErrors
from impostor_jax.fit.seen import all_shown_by, seen_by
from impostor_jax.fit.shapes import fit_shape
from impostor_jax.fit.text import millimeters
from impostor_jax.numerics import nan_where
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.local_world import LocalWorld
from impostor_jax.primitives.tube import Tube
from impostor_jax.text import text_or_repr

NAMES = {"radius": "outer_radius"}
"""Of a cylinder's parameters, what a tube calls otherwise."""

STARTS = (0.9, 0.7, 0.5, 0.3)
"""Inner radii, in outer ones, that a fit begins with where the cylinder has a start."""


class BoreTest(eqx.Module):
    """Test of a cylinder, a tube without a bore, against a tube.

    Attributes:
        tube: Fit of the tube.
        statistic: Twice the logarithm of the likelihood's ratio, at least 0.
        p_value: Probability that a cylinder's noise gives as much; 1 where no reading
            shows a bore, NaN where the tube's fit failed.
    """

    tube: Fit
    statistic: Float[Array, "*batch"]
    p_value: Float[Array, "*batch"]

    def is_needed(self, level: float = 0.01) -> Bool[Array, "*batch"]:
        """Whether the readings reject a cylinder.

        Args:
            level: Share of cylinders that are taken for tubes, at most.
        """
        return self.p_value < level

    def __str__(self) -> str:
        return text_or_repr(self, self._text)

    def _text(self) -> str:
        found = self.tube
        if not found.is_shape:
            return f"  bore    not tested: the tube's fit ended as {found.status}"
        answer = "needed" if bool(self.is_needed()) else "not needed"
        return (
            f"  bore    {answer}: radius {millimeters(found.tube.inner_radius)} mm "
            f"(std {millimeters(found.std.inner_radius)}) in "
            f"{millimeters(found.tube.outer_radius)} mm, likelihood ratio "
            f"{float(self.statistic):.2f}, p-value {float(self.p_value):.2g}"
        )


@on_processor
def test_bore(fit: Fit) -> BoreTest:
    """Fit a tube where a cylinder was fitted, and compare the two.

        fit = ij.fit_cylinder(depth, camera, mask=mask)
        if ij.test_bore(fit).is_needed(): ...

    The readings are those of the mask. That a cylinder's fit failed, as it may where a
    bore is seen, does not matter.

    Args:
        fit: As `fit_cylinder` returned it.

    Returns:
        The test. Where no reading shows a bore, as in a view from the side, the
        p-value is 1: none is needed, and one may be there.

    Raises:
        ValueError: The fit is of another shape, of an outline or of a traced call, or
            it was stacked or made anew since.
    """
    request, places = request_of_cylinder(fit, "bore")
    options = request.options
    prior = {NAMES.get(name, name): x for name, x in (options.prior or {}).items()}
    of_tube = dataclasses.replace(
        options,
        fixed=tuple(NAMES.get(name, name) for name in options.fixed),
        prior=prior or None,
    )
    asked = request._replace(kind=TUBE, options=of_tube)
    cost = _costs(request)
    found = [
        fit_shape(asked._replace(initial=start), places=places)
        for start in _starts(request.initial)
    ]

    def cost_of_tube(fit: Fit) -> float:
        return cost(TUBE, fit.shape, fit.pose_errors)

    tube = min(found, key=lambda one: (not one.is_shape, cost_of_tube(one)))
    values = tube.tube
    outer = Cylinder(values.center, values.axis, values.outer_radius, values.height)
    solid = min(
        cost(CYLINDER, shape, one.pose_errors)
        for shape, one in ((fit.cylinder, fit), (outer, tube))
    )
    ratio = 2 * (solid - cost_of_tube(tube)) / _repeats(tube)
    is_seen = np.isfinite(float(tube.std.inner_radius))
    statistic = jnp.asarray(max(ratio, 0.0) if is_seen else 0.0, tube.rms.dtype)
    above = jax.scipy.special.erfc(jnp.sqrt(statistic / 2)) / 2
    p_value = jnp.where(statistic > 0, above, 1)
    is_told = jnp.asarray(tube.is_shape)
    return BoreTest(
        tube=tube,
        statistic=nan_where(~is_told, statistic),
        p_value=nan_where(~is_told, p_value),
    )


def _starts(begin: Cylinder | None) -> list[Any]:
    """Tubes about the start that the cylinder had; None, to look for one, without."""
    if begin is None:
        return [None]
    return [
        Tube(
            begin.center, begin.axis, begin.radius, part * begin.radius, begin.height
        ).solid
        for part in STARTS
    ]


def _repeats(fit: Fit) -> float:
    """Readings that tell as much as one whose error is its own and as `sigma` says."""
    std, noise = fit.std.inner_radius, fit.std_budget["noise"].inner_radius
    shared = float(std) / max(float(noise), np.finfo(float).tiny)
    wider = shared**2 if np.isfinite(shared) else 1.0
    return max(float(fit.chi2), 1.0) * max(wider, 1.0)


def _costs(request: FitRequest) -> Any:
    """How badly shapes of the world explain the readings of a fit, as a function."""
    options, views = request.options, request.views
    plain = dataclasses.replace(options, fixed=(), prior=None)
    effort = options.effort
    world = LocalWorld.of(view.camera for view in views)

    def cost(kind: Fittable, shape: Any, errors: PoseErrors | None) -> float:
        with working_precision(effort.precision, request.values) as converted:
            cameras = [view.camera for view in views]
            if errors is not None:
                poses = errors.corrected([one.camera_from_world for one in cameras])
                cameras = list(map(posed_at, cameras, poses))
            if world is not None:
                shape, cameras = world.near(shape), list(map(world.seen_by, cameras))
            shape = converted(shape)
            seen = [
                seen_by(
                    np.asarray(view.depth),
                    view.mask,
                    converted(camera),
                    converted(checked_noise(view.sigma, view.camera)),
                )
                for view, camera in zip(views, cameras, strict=True)
            ]
            clear = [one.without_edges() for one in seen]
            shown = all_shown_by(clear, effort.readings)
            settings = checked_settings(kind, plain, None, request.sigma)
            known = checked_prior(None, kind.expectable, None)
            inputs = Inputs(known, settings, shown, effort.kernel)
            return float(quickly_compiled(_cost)(inputs, kind.body.of(shape)))

    return cost


def _cost(inputs: Inputs, body: AbstractBody) -> Float[Array, ""]:
    problem = posed(inputs)
    body = body.transformed(inputs.tables[0].camera_from_world)
    views = problem.views
    bodies = [view.own(body) for view in views]
    readings = readings_of(problem, bodies, [view.noise for view in views])
    return cost_of(problem, body, readings, hidden_pixels(problem, body))
