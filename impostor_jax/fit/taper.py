"""Whether the readings of a cylinder need a frustum: Wald's test.

A cylinder is the frustum without taper. The frustum is fitted, and the square of the
difference of its radii over the variance of that is chi-squared with one degree of
freedom where there is none.
"""

__all__ = ["TaperTest", "test_taper"]

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.arguments import is_exact
from impostor_jax.device import on_processor
from impostor_jax.fit.fittable import FRUSTUM
from impostor_jax.fit.request import request_of_cylinder
from impostor_jax.fit.result import Fit
from impostor_jax.fit.shapes import fit_shape
from impostor_jax.fit.text import millimeters
from impostor_jax.geometry.vec3 import unit
from impostor_jax.numerics import nan_where
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.text import text_or_repr


class TaperTest(eqx.Module):
    """Test of a cylinder, a frustum without taper, against a frustum.

    Attributes:
        frustum: Fit of the frustum.
        statistic: Square of the difference of its radii over the variance of that
            (Wald's); of a cylinder it is chi-squared with one degree of freedom.
        p_value: Probability that a cylinder's noise gives as much; NaN where the
            frustum's fit failed.
    """

    frustum: Fit
    statistic: Float[Array, "*batch"]
    p_value: Float[Array, "*batch"]

    def is_needed(self, level: float = 0.01) -> Bool[Array, "*batch"]:
        """Whether the readings reject a cylinder.

        Args:
            level: Share of cylinders that are taken for frusta.
        """
        return self.p_value < level

    def __str__(self) -> str:
        return text_or_repr(self, self._text)

    def _text(self) -> str:
        found = self.frustum
        if not bool(found.success):
            return f"  taper   not tested: the frustum's fit ended as {found.status}"
        ends = found.frustum.radius1, found.frustum.radius2
        radius1, radius2 = map(millimeters, ends)
        answer = "needed" if bool(self.is_needed()) else "not needed"
        return (
            f"  taper   {answer}: radius {radius1} to {radius2} mm along the axis, "
            f"Wald statistic {float(self.statistic):.2f}, p-value "
            f"{float(self.p_value):.2g}"
        )


@on_processor
def test_taper(fit: Fit) -> TaperTest:
    """Fit a frustum where a cylinder was fitted, and compare the two.

        fit = ij.fit_cylinder(depth, camera)
        if ij.test_taper(fit).is_needed(): ...

    Args:
        fit: As `fit_cylinder` returned it.

    Raises:
        ValueError: It is of another shape, of an outline or of a traced call, or it was
            stacked or made anew since; or its radius was fixed or expected.
    """
    request, places = request_of_cylinder(fit, "taper")
    options = request.options
    if "radius" in {*options.fixed, *(options.prior or {})}:
        raise ValueError(
            "fit must leave the radius open to test its taper, got one in which it is "
            "fixed or expected: a frustum has two"
        )
    begin = fit.cylinder if fit.success else request.initial
    initial = None
    if begin is not None:
        half = unit(begin.axis) * (begin.height / 2)
        if is_exact(begin.center):
            # Beside an array of JAX it would be rounded.
            half = np.asarray(half)
        ends = begin.center - half, begin.center + half
        initial = Frustum(*ends, begin.radius, begin.radius)
    asked = request._replace(kind=FRUSTUM, initial=initial)
    frustum = fit_shape(asked, places=places)
    first = frustum.coordinates.index("radius1")
    (one, both), (_, two) = frustum.covariance[first : first + 2, first : first + 2]
    difference = frustum.frustum.radius2 - frustum.frustum.radius1
    statistic = difference**2 / (one + two - 2 * both)
    p_value = jax.scipy.special.erfc(jnp.sqrt(statistic / 2))
    return TaperTest(
        frustum=frustum,
        statistic=nan_where(~frustum.success, statistic),
        p_value=nan_where(~frustum.success, p_value),
    )
