"""What a fit returns."""

__all__ = [
    "LARGE_GAP",
    "Asked",
    "Directions",
    "Fit",
    "FitResult",
    "FrustumDeviations",
    "FrustumFit",
    "OutlineGap",
    "SphereDeviations",
    "SphereFit",
    "each_of",
    "is_sure",
    "name_of",
    "named_values",
    "of_images",
    "on_device",
]

import dataclasses
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.arguments import is_exact
from impostor_jax.device import on_processor
from impostor_jax.fit.across import AcrossRays
from impostor_jax.fit.alternatives import Alternatives, Named
from impostor_jax.fit.budget import Budget, Deviations, Values
from impostor_jax.fit.form import BY_CHANCE, Form
from impostor_jax.fit.pixelwise import Image, Pixelwise
from impostor_jax.fit.pose import Pose, pose_from_camera, pose_of
from impostor_jax.fit.record import FIT_VERSION, fit_record
from impostor_jax.fit.status import STATUSES, FitStatus
from impostor_jax.fit.text import as_sentence, line, millimeters, plain
from impostor_jax.geometry.frames import RigidTransform, moved_by
from impostor_jax.numerics import nan_where
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.solid import Solid
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.primitives.tube import Tube, as_tube
from impostor_jax.text import text_or_repr

Shape = TypeVar("Shape", bound=AbstractPrimitive)
Told = TypeVar("Told")

TOLD = {
    Cylinder: ("center", "axis", "radius", "height"),
    Frustum: ("p1", "p2", "axis", "radius1", "radius2"),
    Sphere: ("center", "radius"),
    Box: ("center", "rotation", "size"),
    Solid: ("center", "axis", "outer_radius", "inner_radius", "height"),
}
"""What a reader is told of each shape; a solid that is fitted is a tube."""

EXTENT = (
    "An end is not seen: height is the visible extent, center its middle; across the "
    "axis the center's"
)

UNSEEN = {
    Box: "A face is not seen: size is the visible extent, center its middle; along the "
    "edges the center's",
    Cylinder: EXTENT,
    Solid: EXTENT,
    Frustum: "An end is not seen: it is put where the wall was last seen; across the "
    "axis the middle's",
}
"""What it means where an end is not seen."""

OF_MASK = (
    "  Where no plane is seen around its foot, depth does not tell where it stands: a "
    "mask of all of it does, with mask_meaning='outline'."
)
"""What a reader is told besides, of a mask that says nothing of an end."""

OF_FOOT = (
    "  It is taken to end where a plane that is seen around its foot meets it, as on a "
    "table."
)
"""What a reader is told of an end that depth alone does not tell."""

OF_SOURCE = {
    "points": "  Of points: neither background beside an end nor an outline counts.",
    "outline": "  Of an outline: scale and distance rest on what was known beforehand.",
}
"""What a reader is told of a fit that is of no depth images."""

NOTED_CHI2 = 2.0
"""Reduced chi-squared of a fit that converged, from which on a reader is told."""

NOTED_TIMES = 3.0
"""Noises from which the size of residuals is the reason of a poor fit."""

NOTED_GAP = 2.0
"""Deviations from which a reader is told of an outline gap."""

EDGE = (
    "The mask's edge is no silhouette of the shape, or is off by more than sigma says, "
    "in pixels."
)
"""What a reader is told of a poor fit to an outline alone."""

LARGE_GAP = 0.1
"""Outline gap in radii from which a reader is told of it, and above which a fit is no
success, where it is significant, too. On real images of three cans, a mug and a tin
whose radius comes out right it is 0 to 0.04."""

DISAGREEING = 50.0
"""Contradiction between border and rest, of 7 degrees of freedom in a cylinder, from
which something else is taken to lie at the border: by chance once in 1e8 fits."""

AGREEING = 20.0
"""Contradiction between border and rest below which nothing else lies there, once it
has been found to: by chance one in 200 is larger, and costs no more than some readings.
"""

POSES = (
    "Poses may be wrong: each camera_from_world maps points of the world to the "
    "camera's frame, in meters."
)
"""What is added of several views where the solver got lost."""

DISAGREE = (
    "Views disagree by more than their noise: a pose may be off; std allows for it."
)

SURE = 1e-3
"""P-value of a fit from which on nothing is doubted."""


def each_of(values: Any) -> Sequence[Any]:
    """What is told of each image, or given, of one alone or of several."""
    return values if isinstance(values, list | tuple) else [values]


def of_images(values: Sequence[Told]) -> Told | tuple[Told, ...]:
    """What a fit tells of its images: of one alone that, of several all of them."""
    return values[0] if len(values) == 1 else tuple(values)


def named_values(shape: AbstractPrimitive) -> Named:
    """What a reader is told of a shape, or a batch of them, by name."""
    held = as_tube(shape) if isinstance(shape, Solid) else shape
    return {name: getattr(held, name) for name in TOLD[type(shape)]}


def name_of(kind: type[AbstractPrimitive]) -> str:
    """What a caller calls a primitive; a solid that is fitted is a tube."""
    return "tube" if kind is Solid else kind.__name__.lower()


ALIGNED = (
    "Readings were copied to several pixels, as where depth is aligned to color, and "
    "walls lean outward: native depth is better."
)


class Directions(eqx.Module):
    """What an image determines: the principal directions of the estimate's error.

    Attributes:
        coordinates: Whether each coordinate of the covariance is determined.
        vector: One direction a row, the least certain first, in these coordinates, with
            angles times half the shape's size, so that all are motions of its surface
            in meters; of unit length.
        deviation: Standard deviation along each, in meters; `inf` where the image
            leaves it free. Of a cylinder, a slide along the axis has its weight in
            `center_along` and `height`, radius against distance in `radius` and
            `center_first` or `center_second`.
    """

    coordinates: Bool[Array, "*batch m"]
    vector: Float[Array, "*batch m m"]
    deviation: Float[Array, "*batch m"]


class OutlineGap(NamedTuple):
    """How far a wall's silhouette in the image lies from that of the fit.

    Positive where the image shows the surface beyond the fit's outline, which is then
    too small or beside it; negative where it shows background within. Of both sides of
    the wall, and of several images, it is the one with the most deviations.

    Attributes:
        pixels: The gap, as the median along the wall's side; 0 where the outline lies
            between the last reading of the surface and the first of the background.
        radii: The same in radii of the fit.
        deviations: The same in standard deviations, those of the next two together.
        fit_pixels: Standard deviation of the fit's outline.
        edge_pixels: Of the edge in the image: a pixel, and what the sensor may move an
            edge by.
    """

    pixels: float
    radii: float
    deviations: float
    fit_pixels: float
    edge_pixels: float


class PoseErrors(eqx.Module):
    """What the poses of several cameras are found to be off by.

    Each leads from a camera's frame as it was given to its own: a turn about its axes,
    in radians, and then a shift along them, in meters.

    Attributes:
        value: Turn and shift of each camera.
        std: Their standard deviations; of a `SphericalCamera` along the axes of a frame
            that is turned to the object.
        freedom: How many of them the views tell, each with the part by which they take
            from its variance.
    """

    value: Float[Array, "*batch v 6"]
    std: Float[Array, "*batch v 6"]
    freedom: Float[Array, "*batch"]

    def corrected(self, poses: Sequence[RigidTransform | None]) -> list[RigidTransform]:
        """The poses of the cameras as they are found to be.

        Args:
            poses: From the world to each camera, as they were given.
        """
        moves = map(moved_by, jnp.asarray(self.value))
        return [
            move if pose is None else move @ pose
            for move, pose in zip(moves, poses, strict=True)
        ]


@jax.tree_util.register_pytree_node_class
@dataclasses.dataclass(frozen=True)
class Asked:
    """What a fit was asked; no part of its tree, so that any change of that forgets it.

    Attributes:
        arguments: Of a `FitRequest`, by name, once the fit has ended; None where it was
            traced, stacked, or made from another.
        measured: What is told of the noise, where no `sigma` was given.
        poses: What is told of poses, where no `pose_sigma` was.
        doubt: What is wrong with that which was given, or may be, in words.
        is_thinned: Whether more readings were given than a fit takes.
        is_quick: Whether the answer was not doubted, as of an `Effort`.
        stands: Whether it stands on something, which an end was taken from.
        contradiction: In words, what of that which was stated, or of the outline, the
            readings exclude; None if nothing, or where the fit was traced or stacked.
        outline_gap: Of the fit; None where no image shows the outline, or likewise.
        each: The same of each of several fits.
    """

    arguments: dict[str, Any] | None = None
    measured: str = ""
    poses: str = ""
    doubt: str = ""
    is_thinned: bool = False
    is_quick: bool = False
    stands: bool = False
    contradiction: str | None = None
    outline_gap: OutlineGap | None = None
    each: tuple["Asked", ...] = ()

    def tree_flatten(self) -> tuple[tuple[()], None]:
        """No leaves."""
        return (), None

    @classmethod
    def tree_unflatten(cls, _: None, leaves: tuple[()]) -> "Asked":
        """Nothing is known of what was asked."""
        return cls()


def on_device(leaves: Iterable[Any], are_exact: Iterable[bool]) -> list[Any]:
    """NumPy's as JAX's, each in its own precision, but for what lies far off."""
    with jax.enable_x64(True):
        return [
            leaf if exact else jax.device_put(leaf)
            for leaf, exact in zip(leaves, are_exact, strict=True)
        ]


class Fit(eqx.Module):
    """A fitted shape; read `success` and `status` first.

    Where there are several, every array has leading axes, and what needs a single one
    is asked of each: they can be counted, indexed and iterated.

    Attributes:
        shape: The estimate, in the world frame: a cylinder, a frustum, a sphere or a
            box, and `cylinder`, `frustum`, `sphere` and `box` are names of it; or a
            tube, which is a solid, and `tube` has its values. The axis is signed so
            that its largest component is positive, and so is that of a frustum from p1
            to p2, if its p1 is not that of `initial`. Where an end is not seen, it is
            put where the wall was last seen; a frustum's radius is the wall's there.
            Where a camera is 64 m from the origin or more, as in map coordinates, its
            places are NumPy arrays in double precision.
        std: One standard deviation of each parameter, from `covariance`; all `inf`
            where the fit failed, but for one that is ambiguous, and for an outline that
            leaves something undetermined: what that tells is finite.
        std_budget: What these are made of: a user sees what to improve.
        covariance: Of the shape's `coordinates`, in meters and radians; widened where
            the residuals are larger than `sigma` says, and where there are
            alternatives: it is about the estimate, over all solutions. `inf` on the
            diagonal where undetermined, and 0 beside it; 0 where held. Of a frustum's
            radius at an unseen end it is that of the wall where it was last seen.
        coordinates: Names of the covariance's coordinates. Those called first and
            second are along the two vectors of `tangent_basis(axis)`.
        ends_seen: Whether the image shows the ends: of a cylinder that at
            center - axis * height / 2 and the other, of a frustum p1 and p2. A sphere
            has none, and a box six, two along each of its axes.
        observed: Which directions the image determines.
        success: Whether the fit converged to a shape that explains the readings.
        status_code: Position of `status` in `FitStatus`; the form that can be traced.
        num_steps: Steps of the solver.
        num_starts: Starts that were tried.
        num_agreeing: Those among them that led to the same shape, the best included.
        pixelwise: What is told of each reading, of which `residual`, `inliers` and
            `region` are images; one of each image that was given.
        num_pixels: Number of pixels that were used.
        rms: Root mean square of the inliers' residuals, in meters.
        chi2: Mean square of the inliers' residuals, in standard deviations of the
            noise: 1 where that is right.
        tail: `p_value`, or -1 where no `sigma` was given: no compiled program returns
            NaN.
        border_chi2: Chi-squared, of as many degrees of freedom as there are
            coordinates or less, by which readings beside the region's border contradict
            the others; `inf` where many of them lie elsewhere, 0 of an outline.
        alternatives: Other solutions that differ by more than five standard deviations.
            They are known where several starts were tried.
        across: What readings err by across their rays: what the noise model, or the
            points' grid, says, and what was learned from the residuals.
        form: How the wall of a cylinder or a frustum departs from one.
        pose_errors: What the poses of several cameras are found to be off by; None
            where they are exact.
        source: What the fit is of: "images", or "points", which show neither
            background beside an end nor an outline, or "outline", a mask without depth.
        asked: What `test_taper` and `test_bore` need; the depth image, or the mask of
            an outline, is kept in it.
    """

    shape: AbstractPrimitive
    std: Deviations
    std_budget: Budget
    covariance: Float[Array, "*batch m m"]
    coordinates: tuple[str, ...] = eqx.field(static=True)
    ends_seen: Bool[Array, "*batch e"]
    observed: Directions
    success: Bool[Array, "*batch"]
    status_code: Int[Array, "*batch"]
    num_steps: Int[Array, "*batch"]
    num_starts: Int[Array, "*batch"]
    num_agreeing: Int[Array, "*batch"]
    pixelwise: tuple[Pixelwise, ...]
    num_pixels: Int[Array, "*batch"]
    rms: Float[Array, "*batch"]
    chi2: Float[Array, "*batch"]
    tail: Float[Array, "*batch"]
    border_chi2: Float[Array, "*batch"]
    alternatives: Alternatives
    across: AcrossRays
    form: Form
    pose_errors: PoseErrors | None = None
    source: str = eqx.field(static=True, default="images")
    asked: Asked = dataclasses.field(default_factory=Asked, repr=False)

    # Equinox makes a module of each method that is asked for, in 0.1 ms.
    __getattribute__ = object.__getattribute__

    @property
    def cylinder(self) -> Cylinder:
        """The estimate, where it is a cylinder."""
        return self._shape_of(Cylinder)

    @property
    def frustum(self) -> Frustum:
        """The estimate, where it is a frustum."""
        return self._shape_of(Frustum)

    @property
    def box(self) -> Box:
        """The estimate, where it is a box."""
        return self._shape_of(Box)

    @property
    def sphere(self) -> Sphere:
        """The estimate, where it is a sphere."""
        return self._shape_of(Sphere)

    @property
    def tube(self) -> Tube:
        """What the estimate is given by, where it is a tube."""
        return as_tube(self._shape_of(Solid))

    @property
    def residual(self) -> Image | tuple[Image, ...]:
        """Reading less depth of the surface in meters, for each pixel that was used.

        It is 0 elsewhere; of the surface as the sensor shows it, which may have another
        scale. Of several images a tuple with one each, as are the next. They are made
        when they are asked for: keep what is used often.
        """
        return of_images([part.residuals for part in self.pixelwise])

    @property
    def inliers(self) -> Image | tuple[Image, ...]:
        """Pixels that were used and lie on the fitted shape."""
        return of_images([part.inliers for part in self.pixelwise])

    @property
    def region(self) -> Image | tuple[Image, ...]:
        """Pixels that were used.

        Those of the mask, or of the object that was taken where none was given, that
        have a reading that is of the shape's surface.
        """
        return of_images([part.region for part in self.pixelwise])

    @property
    def p_value(self) -> Float[Array, "*batch"]:
        """Probability of a larger `chi2` if the noise is what `sigma` says.

        And if no two readings share an error, to a normal approximation; NaN where no
        `sigma` was given, nor measured in the image. Of thousands of readings it tells
        a noise that is 5 percent too large, so the status goes by `chi2`.
        """
        return nan_where(self.tail < 0, self.tail)

    @property
    def kind(self) -> str:
        """What was fitted: a box, a cylinder, a frustum, a sphere or a tube."""
        return name_of(type(self.shape))

    def _shape_of(self, kind: type[Shape]) -> Shape:
        if isinstance(self.shape, kind):
            return self.shape
        wanted, found = name_of(kind), self.kind
        # What looks for attributes, as `inspect` does, goes on.
        raise AttributeError(
            f"fit.{wanted} needs the fit of a {wanted}, got that of a {found}: it is "
            f"fit.shape or fit.{found}"
        )

    @property
    def height_observed(self) -> bool:
        """Whether all ends are seen; needs a single, concrete result."""
        return bool(self.ends_seen.all())

    @property
    def stands(self) -> bool:
        """Whether an end is taken from what it stands on, whose plane goes around it.

        Depth alone does not exclude that it goes on below. False where it was traced or
        stacked.
        """
        return self.asked.stands

    @property
    def num_inliers(self) -> int:
        """Pixels that lie on the shape; needs a single, concrete result."""
        marks = [np.asarray(part.marks) for part in self.pixelwise]
        return sum(int(np.count_nonzero(x == 2)) for x in marks)

    @property
    def status(self) -> FitStatus:
        """How the fit ended; needs a single, concrete result.

        Raises:
            TypeError: There are several fits.
        """
        if np.ndim(self.status_code):
            raise TypeError("there are several fits: statuses has how each ended")
        return STATUSES[int(self.status_code)]

    @property
    def outline_gap(self) -> OutlineGap | None:
        """How far the image's outline of a cylinder's wall lies from the fit's.

        None where no image shows it: without background behind the wall's sides, of
        other shapes, of points, and of a fit that was traced, stacked or failed.
        """
        return self.asked.outline_gap

    def __bool__(self) -> bool:
        return True

    def __len__(self) -> int:
        self._check_several()
        return len(self.status_code)

    def __iter__(self) -> Iterator["Fit"]:
        self._check_several()
        return (self[k] for k in range(len(self)))

    @on_processor
    def __getitem__(self, which: Any) -> "Fit":
        """One of several fits by its number; several by a slice, numbers or flags.

        Raises:
            TypeError: There is but one.
            IndexError: There is no such fit.
        """
        self._check_several()
        chosen = np.arange(len(self))[which]
        leaves, tree = jax.tree.flatten(self)
        # By NumPy: JAX takes several milliseconds.
        parts = [np.asarray(values)[chosen] for values in leaves]
        part = tree.unflatten(on_device(parts, map(is_exact, leaves)))
        if not self.asked.each:
            return part
        each = tuple(self.asked.each[k] for k in chosen.ravel())
        return part.noting(**({"each": each} if chosen.ndim else vars(each[0])))

    def _check_several(self) -> None:
        if not np.ndim(self.status_code):
            raise TypeError("there is one fit: it has no length, nor numbers")

    @property
    def statuses(self) -> tuple[FitStatus, ...]:
        """How each of several fits ended."""
        return tuple(fit.status for fit in self)

    @property
    def reasons(self) -> tuple[str, ...]:
        """What is behind the status of each of several fits, in words."""
        return tuple(fit.reason for fit in self)

    @property
    def is_shape(self) -> bool:
        """Whether the shape is one that explains the readings, if not the only one."""
        return self.status in (FitStatus.CONVERGED, FitStatus.AMBIGUOUS)

    @property
    def reason(self) -> str:
        """What is behind `status`, in words; needs a single, concrete result."""
        if self.status is FitStatus.CONTRADICTED and self.asked.contradiction:
            return self.asked.contradiction
        is_poor = self.status is FitStatus.POOR_FIT
        told = [self._why_poor if is_poor else self.status.meaning]
        if self.status is FitStatus.UNDETERMINED and self.asked.measured:
            # With less noise they may.
            told.append(self.asked.measured)
        if self._counts("alignment") and not is_poor:
            told.append(ALIGNED)
        if self.pose_errors is None and self._counts("poses") and not is_poor:
            told.append(DISAGREE)
        got_lost = self.status in (FitStatus.STEP_LIMIT, FitStatus.NOT_FINITE)
        if len(self.pixelwise) > 1 and got_lost:
            told.append(POSES)
        if self.is_shape and self.chi2 >= NOTED_CHI2 and self._is_weighed:
            told.append(f"But {self._residuals}: sigma or the shape may be wrong.")
        if self.is_shape and self.form.departs:
            told.append(f"The wall departs: {self.form}; std allows for it.")
        if self.asked.doubt:
            told.append(as_sentence(self.asked.doubt))
        return " ".join(told)

    @property
    def _is_weighed(self) -> bool:
        """Whether somebody knows the noise that chi-squared is told in."""
        return not np.isnan(self.p_value)

    @property
    def _residuals(self) -> str:
        times = float(np.sqrt(self.chi2))
        known = "measured" if self.asked.measured else "given"
        return f"the residuals are {times:.1f} times the noise {known}"

    @property
    def _why_poor(self) -> str:
        several = len(self.pixelwise) > 1
        if self.chi2 >= NOTED_TIMES**2 and self._is_weighed:
            posed = ", or a pose is" if several else ""
            return as_sentence(
                f"{self._residuals}: the shape or sigma is wrong{posed}."
            )
        if self.source == "outline":
            return EDGE
        if 2 * self.num_inliers < int(self.num_pixels):
            return "Most readings lie off the shape."
        if self.border_chi2 >= AGREEING:
            posed = ", a pose is wrong" if several else ""
            return (
                "Readings beside the region's border contradict the others: the mask "
                f"is too large{posed}, or errors are correlated."
            )
        if several:
            return (
                "The views contradict each other: a pose is wrong, or errs by more "
                "than pose_sigma says, they show different things, or they err by more "
                "than sigma says."
            )
        return "Part of the region lies off the shape: it, or the mask, is wrong."

    def _counts(self, name: str) -> bool:
        """Whether deviations allow for a part of their budget."""
        shares = self.std_budget[name].values.values()
        return any(
            bool(np.any(np.isfinite(x) & (x > 0))) for x in map(np.asarray, shares)
        )

    def failed(self, status: FitStatus) -> "Fit":
        """The same estimate as a failure, with infinite standard deviations."""
        std, budget = jax.tree.map(
            lambda x: jnp.full_like(x, jnp.inf), (self.std, self.std_budget)
        )
        return self.having(
            success=jnp.zeros_like(self.success),
            status_code=jnp.full_like(self.status_code, STATUSES.index(status)),
            std=std,
            std_budget=budget,
        )

    def noting(self, **facts: Any) -> "Fit":
        """The same with fields of what was asked; its tree stays."""
        return self.having(asked=dataclasses.replace(self.asked, **facts))

    def having(self, **fields: Any) -> "Fit":
        """The same with other fields, in a tenth of the time of a call of its class."""
        # A copy by `copy.copy` is begun by `Module.__new__`, which keeps it for good.
        fit = object.__new__(type(self))
        vars(fit).update(vars(self), **fields)
        return fit

    def contradicted(self, reason: str) -> "Fit":
        """The same as a failure, since readings exclude what was stated.

        Args:
            reason: What, and what the readings say, in a sentence or more.
        """
        failed = self.failed(FitStatus.CONTRADICTED)
        return failed.noting(contradiction=as_sentence(reason))

    @property
    def told(self) -> dict[str, tuple[Values, Values]]:
        """Value and standard deviation of what a reader is told, by name."""
        values = named_values(self.shape)
        return {
            name: (value, getattr(self.std, name)) for name, value in values.items()
        }

    @property
    def pose(self) -> Pose:
        """`world_from_object`: the frame at the center, with z along the axis.

        A frustum's center is midway between its ends, and a sphere's frame is not
        turned.
        """
        return pose_of(self.shape)

    @property
    def pose_in_camera(self) -> Pose | tuple[Pose, ...]:
        """`camera_from_object`, of the same frame; of several images one for each.

        It needs a fit to images, as it was returned.
        """
        if self.asked.arguments is None or self.source == "points":
            # What looks for attributes, as `inspect` does, goes on.
            raise AttributeError(
                "fit.pose_in_camera needs a fit to images, as it was returned: one "
                "that was traced or stacked does not hold its camera, nor one of too "
                "few readings; multiply fit.pose by the camera's camera_from_world"
            )
        cameras = each_of(self.asked.arguments["camera"])
        poses = [one.camera_from_world for one in cameras]
        if self.pose_errors is not None:
            poses = self.pose_errors.corrected(poses)
        return of_images([pose_from_camera(self.pose, pose) for pose in poses])

    def to_dict(
        self,
        seconds: float | None = None,
        taper: Any = None,
        bore: Any = None,
    ) -> dict[str, Any]:
        """What JSON can hold of a concrete result, as in `fit.json`.

        The keys are the same for every shape but those of its parameters, and are in
        `impostor_jax/io/schemas/fit.schema.json`; what is not finite is None. Of
        several fits it is a list of these by the name "fits", and no argument is taken.

        Args:
            seconds: Time that the fit took.
            taper: The `TaperTest`, if there was one.
            bore: The `BoreTest`, if there was one.
        """
        if np.ndim(self.status_code):
            return {"version": FIT_VERSION, "fits": [fit.to_dict() for fit in self]}
        return fit_record(
            self, self.alternatives.told(named_values), seconds, taper, bore
        )

    def summary(self, seconds: float | None = None) -> str:
        """A few lines for a reader; lengths in millimeters, angles in degrees.

        Args:
            seconds: Time that the fit took; left out if None.
        """
        time = "" if seconds is None else f", {seconds:.2f} s"
        head = (
            f"{self.status}: {self.reason} {int(self.num_steps)} steps, "
            f"{int(self.num_agreeing)} of {int(self.num_starts)} starts agree, "
            f"{int(self.num_pixels)} pixels{time}"
        )
        if not self.is_shape:
            return head
        rms = (
            f"  rms     {millimeters(self.rms)} mm over {self.num_inliers} inliers, "
            f"chi-squared {float(self.chi2):.2f}"
        )
        told = [line(name, *values) for name, values in self.told.items()]
        lines = [head, *told, rms, *self._alternatives_told()]
        telling = {"correlation", "warp", "scale", "alignment", "poses", "form"}
        if telling & set(self.std_budget.some):
            lines += [
                f"  std of {name}: {_made_of(self.std_budget.of(name))} mm"
                for name in self.told
                if "radius" in name and np.isfinite(getattr(self.std, name))
            ]
        if self.across.deviation > 0:
            lines.append(
                f"  Readings err by {millimeters(self.across.deviation)} mm across "
                "their rays."
            )
        if self.asked.is_thinned:
            which = (
                "evenly spread" if self.source == "points" else "half beside the border"
            )
            lines.append(
                f"  More readings were given than the {self.num_pixels} that were "
                f"taken, {which}."
            )
        if self.asked.is_quick:
            lines.append(
                "  Nothing was doubted: more effort looks for other solutions, and for "
                "what is not of the object at its region's border."
            )
        told = filter(None, (self.asked.measured, self.asked.poses))
        lines += [f"  {one}" for one in told]
        gap = self.outline_gap
        if gap is not None and (
            abs(gap.deviations) >= NOTED_GAP or abs(gap.radii) >= LARGE_GAP
        ):
            lines.append(
                f"  The image's outline is {gap.pixels:+.1f} pixels off the fit's: "
                f"{100 * gap.radii:+.0f} % of the radius, {gap.deviations:+.1f} "
                "deviations."
            )
        if self.stands:
            lines.append(OF_FOOT)
        if self.source in OF_SOURCE:
            lines.append(OF_SOURCE[self.source])
        if not self.height_observed:
            std = self.std
            across = std.along_edges if self.kind == "box" else std.across_axis
            lines.append(
                f"  {UNSEEN[type(self.shape)]} std is {millimeters(across)} mm."
            )
            asked = (self.asked.arguments or {}).get("options")
            if asked and (self.source, asked.mask_meaning) == ("images", "region"):
                lines.append(OF_MASK)
        return "\n".join(lines)

    def _alternatives_told(self) -> list[str]:
        """A line for each other solution."""
        return [
            f"  or with {100 * weight:.1f} %: "
            + ", ".join(plain(name, value) for name, value in values.items())
            for weight, values in self.alternatives.told(named_values)
        ]

    def __str__(self) -> str:
        return text_or_repr(self, self._text)

    def _text(self) -> str:
        codes = np.asarray(self.status_code)
        if codes.ndim == 0:
            return self.summary()
        count = Counter(str(STATUSES[int(code)]) for code in codes.ravel())
        found = ", ".join(f"{number} {status}" for status, number in count.items())
        return f"{codes.size} fits: {found}"


def is_sure(fit: Fit) -> bool:
    """Whether nothing about a single, concrete fit is doubted.

    Without `form.departs` and `p_value`, which take JAX a millisecond.
    """
    is_round = fit.form.chi2.item() <= BY_CHANCE
    return bool(fit.success) and is_round and fit.tail.item() > SURE


def _made_of(parts: dict[str, Values]) -> str:
    return ", ".join(f"{name} {millimeters(std)}" for name, std in parts.items())


FitResult = FrustumFit = SphereFit = Fit
FrustumDeviations = SphereDeviations = Deviations
"""Names of version 0.1, when each shape had classes of its own."""
