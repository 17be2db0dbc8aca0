"""Fit one shape to what is seen of it: a cylinder, a frustum, a sphere or a tube."""

__all__ = ["fit_box", "fit_cylinder", "fit_frustum", "fit_sphere", "fit_tube"]

from collections.abc import Mapping, Sequence
from typing import Any

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.device import on_processor
from impostor_jax.effort import Effort, effort_of
from impostor_jax.fit.fittable import BOX, CYLINDER, FRUSTUM, SPHERE, TUBE
from impostor_jax.fit.options import Errors, MaskMeaning, Options, Scale
from impostor_jax.fit.request import FitRequest
from impostor_jax.fit.result import Fit
from impostor_jax.fits.shown import fit_shown
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.solid import Solid
from impostor_jax.primitives.sphere import Sphere

Cameras = AbstractCamera | Sequence[AbstractCamera]
"""The camera of an image, or those of several."""


@on_processor
def fit_cylinder(
    depth: Any,
    camera: Cameras,
    mask: Any = None,
    sigma: Any = None,
    initial: Cylinder | None = None,
    *,
    fixed: Sequence[str] = (),
    prior: Mapping[str, Any] | None = None,
    mask_meaning: MaskMeaning = "region",
    scale: Scale = "estimated",
    errors: Errors | None = None,
    effort: Effort | str = "balanced",
    pose_sigma: Any = None,
) -> Fit:
    """Fit center, axis, radius and height of a capped cylinder to depth images.

    One image, or several of the same object from cameras whose poses are known, as
    exactly as `pose_sigma` says:

        fit = ij.fit_cylinder(depth, camera, mask=mask, sigma=0.001)
        fit = ij.fit_cylinder([depth1, depth2], [camera1, camera2], mask=[mask1, mask2])

    Several have one likelihood and one covariance; what is told of pixels (`residual`,
    `inliers`, `region`) are tuples then. Their cameras may differ in size and lens. An
    error of scale that a sensor has is counted for each image, or for all alike where
    one noise model is given; no image corrects another's.

    Without depth, of glass or a mirror, the outline alone is fitted, which tells all
    but the scale; a known length, or the distance, tells that:

        fit = ij.fit_cylinder(
            None, camera, mask, prior={"radius": (0.04, 0.0001)}, mask_meaning="outline"
        )

    Inside `jax.jit` or `vmap` give `initial`: the first guess runs outside JAX. A
    traced fit without a mask uses the pixels that `initial` covers. Where the pixels
    are known to the run alone, it takes at most 15872 of them.

    Args:
        depth: (H, W), planar depth in meters; 0, NaN, infinity and what a NumPy masked
            array masks mean no reading. Of a `SphericalCamera` ranges along the rays.
            Or a list of several images. None where there is none, and the mask is an
            outline.
        camera: The camera that took it; a list of as many, each with its pose.
        mask: (H, W), True on pixels of the object, wall and caps together; or one
            integer there and 0 elsewhere. A label image is for `fit_labels`. Where
            the readings beside its border disagree with the others, it is cut down to
            what is of one surface; not so in a traced fit, which fails where many of
            them lie elsewhere.
            Without depth it may hold floats, too: the part of each pixel that is
            covered, from 0 to 1.
            If None, a cylinder is searched for as in `find_cylinders` and the surest
            one is taken; or what reads near `initial`, within half a radius or 5 sigma.
            The pixels are reported as `region`. Of several images a list; those that
            have None are searched for what the others show, or else for what is found
            in the first in which something is.
        sigma: Standard deviation of a reading in meters; an array (H, W) of each, as
            some cameras tell it, where NaN and infinity leave a reading out; or a noise
            model of the sensor, which weighs each reading by its depth and incidence.
            Readings that scatter three times as much make it a `poor_fit`; where they
            scatter less by a tenth or more, each by itself, what is measured is taken,
            unless `scale` is "fixed". If None, it is measured in each image, from the
            object's own readings and from planes around: white noise is a number;
            errors that neighbors share are those of a camera that matches windows, as
            `StructuredLight.sensor` has them, with its scale that no image tells.
            `print(fit)` says what was measured. Where nothing is (fewer than 200
            readings, no noise, a traced fit), 1 mm weighs against priors and outlines,
            and is not held against the readings. Of several images one of all of them,
            or a list. Without depth it is in pixels: of the coverages of a matte, 0.05
            if None; of the edge of a mask of booleans, in places and all along, 0 where
            each pixel tells of its center exactly. If None an edge is exact in places,
            and its deviation all along is half a pixel.
        initial: Start of the fit, in the world frame; found from the image if None.
        fixed: Names of the parameters that keep the value they have in `initial`; none
            by default. A cylinder has center, axis, radius and height; a frustum
            radius1 and radius2 in place of radius, and its center is the midpoint of
            the axis; a tube outer_radius and inner_radius; a sphere has center and
            radius; a box center, rotation and size. A value that the readings exclude
            by more than five standard deviations makes the fit `contradicted`.
        prior: For any of these names, expected value and standard deviation in the
            world frame, in meters and (for the axis) radians, as in
            `{"radius": (0.04, 0.001)}`; none by default. For radius1, radius2 and size
            with `initial` only. Not for what is `fixed`. Its deviation and that of the
            readings are tested together: five apart, the fit is `contradicted`.
        mask_meaning: "region", the default: any subset of the object's pixels, its edge
            has no meaning; where an end stands out before what lies behind, it is known
            to a pixel, or to as many as the sensor mixes at edges. "outline": the edge
            is the object's silhouette, where no occluder stands in front of it; without
            depth it must be.
        scale: What the width of the robust loss is measured by: the "estimated" spread
            of the residuals, the default, or, "fixed", standard deviations of the
            sensor.
        errors: Whether readings err "independent" of each other or "correlated" between
            neighboring pixels as those of real sensors do; decides which covariance is
            reported. What a sensor says of smooth errors (`CorrelatedNoise`) is counted
            in any case. If None, the default, a sensor with a `MatchingWindow` that
            says nothing of them errs correlated, others independent. Where the readings
            contradict independence, they are taken for correlated; in a traced fit only
            if that is said.
        effort: How much work it takes: "fast", "balanced", the default, or "exact", or
            an `Effort` with a setting of each dial, which says what each costs.
        pose_sigma: What the poses of several cameras are off by, each by itself, as
            standard deviations: of the camera's place along each axis, in meters, and
            of its turn about each, in radians, as in `(0.0005, 0.001)`; or a list of
            such pairs, one for each. (0, 0) are exact poses. What the views say of it
            is in `pose_errors`. If None, it is 2e-4 of the distance and 2e-4 radians,
            as after a good calibration, and more where the views disagree, up to 2.5e-3
            of both: `print(fit)` says so. A traced fit takes poses for exact then.

    Returns:
        The fit. A fit that failed says so in `status`, with infinite standard
        deviations. Where other solutions explain the readings, too, `alternatives` has
        them, and the standard deviations cover them; from 5 % of the probability on
        the fit is `ambiguous`. With `initial`, no other is looked for.
        Without depth, `residual` is 0, `rms` how far the mask's edge is from the
        outline at the distance of the object, and `region` what lies beside that edge.
        Where nothing tells the scale, or the outline shows no wall, the status is
        `undetermined`, and the standard deviations of all that is open are infinite.

    Raises:
        ValueError: An argument has a wrong shape, dtype or value, the lists differ in
            length, the mask is empty, or it holds fewer than 50 readings; or without
            depth, the mask is none, or not said to be the outline.

    Derivatives:
        With `initial` given: of the cylinder in the depths, the camera and sigma, by
        the implicit function theorem at the solution.
    """
    how = fixed, prior, mask_meaning, scale, errors, effort_of(effort), pose_sigma
    asked = Options(*how)
    return fit_shown(FitRequest(CYLINDER, depth, camera, mask, sigma, initial, asked))


@on_processor
def fit_frustum(
    depth: Any,
    camera: Cameras,
    mask: Any = None,
    sigma: Any = None,
    initial: Frustum | None = None,
    *,
    fixed: Sequence[str] = (),
    prior: Mapping[str, Any] | None = None,
    mask_meaning: MaskMeaning = "region",
    scale: Scale = "estimated",
    errors: Errors | None = None,
    effort: Effort | str = "balanced",
    pose_sigma: Any = None,
) -> Fit:
    """Fit the ends and the two radii of a capped frustum to a depth image.

    The likelihood, the starts and the covariance are those of `fit_cylinder`, and so is
    what may be traced and differentiated. Without a mask and a start, each of the
    largest objects in front of planes is fitted, and the fit that explains the most
    readings is taken; a plane of a tenth of the image or less that does not reach its
    border, and on which nothing stands, is an object's end. A cylinder is fitted as a
    frustum whose radii agree to within their standard deviations; `test_taper` tells
    the two apart. The tip of a cone is an end that is not seen: the wall is reported as
    far as readings lie on it.

    Args:
        depth: (H, W), or a list, as in `fit_cylinder`, or None.
        camera: The camera that took it, or a list.
        mask: (H, W), as in `fit_cylinder`.
        sigma: As in `fit_cylinder`.
        initial: Start of the fit, in the world frame; found from the image if None.
            It tells which end is p1.
        fixed: Names of parameters that keep their value in `initial`, as in
            `fit_cylinder`; none by default.
        prior: Expected value and standard deviation of parameters by name, in meters
            and radians, as in `fit_cylinder`; none by default.
        mask_meaning: "region" by default, or "outline", as in `fit_cylinder`.
        scale: "estimated" by default, or "fixed", as in `fit_cylinder`.
        errors: "independent" or "correlated"; what `sigma` says if None.
        effort: "fast", "balanced" (the default), "exact" or an `Effort`.
        pose_sigma: What poses of several cameras err by, as in `fit_cylinder`.

    Returns:
        The fit. A fit that failed says so in `status`, with infinite standard
        deviations.

    Raises:
        ValueError: As in `fit_cylinder`.
    """
    how = fixed, prior, mask_meaning, scale, errors, effort_of(effort), pose_sigma
    asked = Options(*how)
    return fit_shown(FitRequest(FRUSTUM, depth, camera, mask, sigma, initial, asked))


@on_processor
def fit_box(
    depth: Any,
    camera: Cameras,
    mask: Any = None,
    sigma: Any = None,
    initial: Box | None = None,
    *,
    fixed: Sequence[str] = (),
    prior: Mapping[str, Any] | None = None,
    mask_meaning: MaskMeaning = "region",
    scale: Scale = "estimated",
    errors: Errors | None = None,
    effort: Effort | str = "balanced",
    pose_sigma: Any = None,
) -> Fit:
    """Fit center, rotation and size of a box to a depth image: a carton, or a room.

        fit = ij.fit_box(depth, camera, mask=mask, sigma=0.001)
        print(fit.box.size, fit.std.size)

    The likelihood, the starts and the covariance are those of `fit_cylinder`, and so is
    what may be traced and differentiated. Without a mask a box is found as a frustum is
    in `fit_frustum`; the planes that it stands out of are those that go on beyond the
    image, and those on which something stands.

    Of six faces an image shows three at most. Where another one is, the background
    beside the outline tells. What nothing tells is open: the size along such an edge is
    the visible extent, with infinite standard deviation, and so is the center's. Of a
    box of which one face alone is seen the status is `undetermined`, as of anything
    that a plane explains as well.

    Args:
        depth: (H, W), or a list, as in `fit_cylinder`.
        camera: The camera that took it, or a list.
        mask: (H, W), as in `fit_cylinder`.
        sigma: As in `fit_cylinder`.
        initial: Start of the fit, in the world frame; found from the image if None. Its
            edges keep their order; without, they are in no order that means anything.
        fixed: Names of parameters that keep their value in `initial`, as in
            `fit_cylinder`; none by default.
        prior: Expected value and standard deviation of parameters by name, in meters
            and radians, as in `fit_cylinder`; none by default.
        mask_meaning: "region" by default, or "outline", as in `fit_cylinder`.
        scale: "estimated" by default, or "fixed", as in `fit_cylinder`.
        errors: "independent" or "correlated"; what `sigma` says if None.
        effort: "fast", "balanced" (the default), "exact" or an `Effort`.
        pose_sigma: What poses of several cameras err by, as in `fit_cylinder`.

    Returns:
        The fit; `std.rotation` is about the box's own axes, in radians, `std.size`
        along its edges, `std.along_edges` that of the center along them. A fit that
        failed says so in `status`, with infinite standard deviations.

    Raises:
        ValueError: As in `fit_cylinder`; or depth is None.
    """
    how = fixed, prior, mask_meaning, scale, errors, effort_of(effort), pose_sigma
    asked = Options(*how)
    return fit_shown(FitRequest(BOX, depth, camera, mask, sigma, initial, asked))


@on_processor
def fit_sphere(
    depth: Any,
    camera: Cameras,
    mask: Any = None,
    sigma: Any = None,
    initial: Sphere | None = None,
    *,
    fixed: Sequence[str] = (),
    prior: Mapping[str, Any] | None = None,
    mask_meaning: MaskMeaning = "region",
    scale: Scale = "estimated",
    errors: Errors | None = None,
    effort: Effort | str = "balanced",
    pose_sigma: Any = None,
) -> Fit:
    """Fit center and radius of a sphere to a depth image.

    The likelihood, the starts and the covariance are those of `fit_cylinder`, and so is
    what may be traced and differentiated. Without a mask a ball is found as a frustum
    is in `fit_frustum`.

    Args:
        depth: (H, W), or a list, as in `fit_cylinder`, or None.
        camera: The camera that took it, or a list.
        mask: (H, W), as in `fit_cylinder`.
        sigma: As in `fit_cylinder`.
        initial: Start of the fit, in the world frame; found from the image if None.
        fixed: Names of parameters that keep their value in `initial`, as in
            `fit_cylinder`; none by default.
        prior: Expected value and standard deviation of parameters by name, in meters
            and radians, as in `fit_cylinder`; none by default.
        mask_meaning: "region" by default, or "outline", as in `fit_cylinder`.
        scale: "estimated" by default, or "fixed", as in `fit_cylinder`.
        errors: "independent" or "correlated"; what `sigma` says if None.
        effort: "fast", "balanced" (the default), "exact" or an `Effort`.
        pose_sigma: What poses of several cameras err by, as in `fit_cylinder`.

    Returns:
        The fit. A fit that failed says so in `status`, with infinite standard
        deviations.

    Raises:
        ValueError: As in `fit_cylinder`.
    """
    how = fixed, prior, mask_meaning, scale, errors, effort_of(effort), pose_sigma
    asked = Options(*how)
    return fit_shown(FitRequest(SPHERE, depth, camera, mask, sigma, initial, asked))


@on_processor
def fit_tube(
    depth: Any,
    camera: Cameras,
    mask: Any = None,
    sigma: Any = None,
    initial: Solid | None = None,
    *,
    fixed: Sequence[str] = (),
    prior: Mapping[str, Any] | None = None,
    mask_meaning: MaskMeaning = "region",
    scale: Scale = "estimated",
    errors: Errors | None = None,
    effort: Effort | str = "balanced",
    pose_sigma: Any = None,
) -> Fit:
    """Fit a tube, of outer and inner radius, to a depth image: a pipe, or a mug.

        fit = ij.fit_tube(depth, camera, mask=mask, sigma=0.001)
        print(fit.tube.inner_radius, fit.std.inner_radius)

    The likelihood, the starts and the covariance are those of `fit_cylinder`, and so is
    what may be traced and differentiated. Without a mask a tube is found as a frustum
    is in `fit_frustum`, with what is seen in its bore. `test_bore` tells whether a bore
    is there at all.

    The bore goes through. Where at least 20 readings in it, and half of those that are
    not its wall's, lie at one place along the axis, they are taken for the floor of a
    mug, or for what the tube stands on: these, all that is deeper and the wall up to a
    fifth of the inner radius above, where the corner may be round, are left out, and no
    part of `region`; `height` is that of the outer wall. Of what else fills a bore up
    to a quarter of the readings in it count as outliers; more are a `poor_fit`. A
    traced fit looks for no floor, and fails where it is a quarter.

    Where no five readings, or places of a rim before background, tell of the bore,
    `std.inner_radius` is infinite and the inner radius that of the start: half the
    outer one, or one that the readings leave room for; a hundredth of it where they
    show that the end is closed. That is no failure. Of a pipe that is seen from inside
    alone the outer radius is as open.

    Args:
        depth: (H, W), or a list, as in `fit_cylinder`.
        camera: The camera that took it, or a list.
        mask: (H, W), as in `fit_cylinder`: outside and inside together. Of what is seen
            through the bore it may hold the pixels or not.
        sigma: As in `fit_cylinder`.
        initial: Start of the fit, as `ij.tube` makes it, in the world frame; found from
            the image if None.
        fixed: Names of parameters that keep their value in `initial`, as in
            `fit_cylinder`; none by default.
        prior: Expected value and standard deviation of parameters by name, in meters
            and radians, as in `fit_cylinder`; none by default.
        mask_meaning: "region" by default, or "outline", as in `fit_cylinder`.
        scale: "estimated" by default, or "fixed", as in `fit_cylinder`.
        errors: "independent" or "correlated"; what `sigma` says if None.
        effort: "fast", "balanced" (the default), "exact" or an `Effort`.
        pose_sigma: What poses of several cameras err by, as in `fit_cylinder`.

    Returns:
        The fit; its values are `fit.tube`. A fit that failed says so in `status`, with
        infinite standard deviations.

    Raises:
        ValueError: As in `fit_cylinder`; or `initial` is another solid than a tube.
    """
    how = fixed, prior, mask_meaning, scale, errors, effort_of(effort), pose_sigma
    asked = Options(*how)
    return fit_shown(FitRequest(TUBE, depth, camera, mask, sigma, initial, asked))
