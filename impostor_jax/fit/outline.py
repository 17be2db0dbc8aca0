"""Fit a shape to its silhouette alone, for what returns no depth: glass, and mirrors.

A silhouette tells all of a shape but how large it is and, with that, how far away: one
known length, or the distance, tells the rest. Guesses of all tilts are followed to
where the outline meets the mask's edge, and the best of them to where the coverages of
the pixels beside it are met best. What else explains the mask is an alternative, as it
is in a fit to depth.
"""

__all__ = ["fit_outline"]

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.arguments import is_concrete, working_precision
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.compiling import quickly_compiled
from impostor_jax.fit.assess import Assessment
from impostor_jax.fit.body import AbstractBody, change_of
from impostor_jax.fit.fittable import BOX, TUBE, Fittable, no_guess
from impostor_jax.fit.guess_outline import guess_outlines
from impostor_jax.fit.matte import Matte, checked_matte
from impostor_jax.fit.outline_assess import assess_outline
from impostor_jax.fit.outline_solve import (
    OutlineProblem,
    Traced,
    outline_problem,
    traced,
)
from impostor_jax.fit.pixelwise import Pixelwise
from impostor_jax.fit.prior import Prior
from impostor_jax.fit.request import (
    FitRequest,
    check_types,
    checked_prior,
    checked_settings,
)
from impostor_jax.fit.result import Fit, name_of
from impostor_jax.fit.stated import tested_by_readings
from impostor_jax.fit.weighing import best_of
from impostor_jax.primitives.base import in_camera_frame

MOST_PLACES = 512
"""Places of the edge that lead the way; more tell no more of it."""

BUCKETS = tuple(1024 << k for k in range(20))
"""Pixels are filled up to one of these numbers, so that few sizes are compiled."""

MORE = 5.0
"""Loss at the edge, half the square pixels of all places, beside that of the best, up
to which a solution may be the better one: of a mask of booleans it is likelier by 60
nats, of a matte by more."""

ASIDE = 0.02
"""Motion in radii, and turn in radians, within which two ways led to the same."""


def fit_outline(request: FitRequest) -> Fit:
    """Fit a shape to a mask without depth.

    Raises:
        ValueError: As of `fit_cylinder`; or the mask is none, or not said to be the
            outline, the camera is no pinhole camera, or there are several, the shape is
            a box or a tube, or something is traced.
    """
    kind, _, camera, mask, sigma, initial, options = request
    if kind in (BOX, TUBE):
        raise ValueError(
            f"depth must be given to fit a {name_of(kind.shape)}, got None: only the "
            "outlines of cylinders, frusta and spheres are fitted"
        )
    if options.mask_meaning != "outline":
        raise ValueError(
            "mask_meaning must be 'outline' where depth is None, got "
            f"{options.mask_meaning!r}: no other mask tells a shape"
        )
    if options.errors == "correlated":
        raise ValueError(
            "errors must be 'independent' where depth is None, got 'correlated'"
        )
    if not isinstance(camera, PinholeCamera):
        raise ValueError(
            "camera must be one PinholeCamera where depth is None, got "
            f"{type(camera).__name__}"
        )
    if options.pose_sigma is not None:
        raise ValueError(
            "pose_sigma must be None where depth is None: one image is all there is"
        )
    check_types(kind.shape, camera, initial)
    if not is_concrete(request.values):
        raise ValueError(
            "mask, camera and what is asked must be concrete where depth is None, got "
            "traced ones: the edge is found outside JAX"
        )
    with working_precision(options.effort.precision, request.values) as converted:
        matte = checked_matte(mask, camera, sigma)
        posed, begin = converted((camera, initial))

        def fitted_as(asked: FitRequest) -> Fit:
            prior = asked.options.prior
            beliefs = checked_prior(prior, kind.expectable, asked.initial)
            return _fit_from(asked, _posed(asked, matte, converted(beliefs)), matte)

        own = request._replace(camera=posed, initial=begin)
        fit = tested_by_readings(fitted_as(own), own, fitted_as)
    arguments = {
        "depth": None, "camera": camera, "sigma": sigma, "initial": initial,
        "options": options,
        # A caller may write other pixels to it.
        "mask": np.array(mask),
    }  # fmt: skip
    return fit.noting(arguments=arguments)


def _fit_from(request: FitRequest, problem: OutlineProblem, matte: Matte) -> Fit:
    """The fit from a start in the world frame, or from guesses."""
    kind, begin, shape = request.kind, request.initial, matte.covered.shape
    if begin is not None:
        start = in_camera_frame(kind.body.of(begin), request.camera)
        return _assessed(problem, _led(problem, start), shape).fit
    finalists = _finalists(kind, problem)[: request.options.effort.starts]
    if finalists:
        return best_of([_assessed(problem, one, shape) for one in finalists])
    failed = no_guess(kind, np.asarray(matte.beside()))
    return failed.having(source="outline")


def _finalists(kind: Fittable, problem: OutlineProblem) -> list[Traced]:
    """Ways to the edge that may be the best: they differ, and end about as near."""
    edge = np.stack([problem.edge.x, problem.edge.y], axis=-1)
    edge = edge[np.asarray(problem.is_place)]
    guesses = guess_outlines(kind.blank, edge)
    ways = [_led(problem, _sized(one, problem.prior)) for one in guesses]
    ways.sort(key=_loss)
    finalists = ways[:1]
    for way in ways[1:]:
        is_near = _loss(way) <= _loss(ways[0]) + MORE
        if is_near and all(_apart(way.body, one.body) > ASIDE for one in finalists):
            finalists.append(way)
    return finalists


def _posed(request: FitRequest, matte: Matte, prior: Prior) -> OutlineProblem:
    """The problem of a mask, in arrays that come in few sizes."""
    kind, _, camera, _, _, initial, options = request
    settings = checked_settings(kind, options, initial, None)
    dtype = matte.covered.dtype
    row, col, cols, rows = matte.edge()
    count = min(len(row), MOST_PLACES)
    some = np.arange(count) * len(row) // count
    places = [part[some] for part in (row, col, cols.astype(dtype), rows.astype(dtype))]
    places = [np.pad(part, (0, MOST_PLACES - count)) for part in places]
    places[0][count:] = camera.height
    row, col = np.nonzero(matte.beside())
    count = len(row)
    more = next(size for size in BUCKETS if size >= count) - count
    pixels = [np.pad(x, (0, more)) for x in (row, col, matte.covered[row, col])]
    pixels[0][count:] = camera.height
    known = {*options.fixed, *(options.prior or {})} - {"axis"}
    facts = {
        "is_hard": matte.is_hard,
        "is_trusted": matte.is_trusted,
        "grows": not {*options.fixed} - {"axis"},
        "has_scale": bool(known),
    }
    return quickly_compiled(outline_problem, static_argnames=("kernel", "max_steps"))(
        places=tuple(map(jnp.asarray, places)),
        pixels=tuple(map(jnp.asarray, pixels)),
        sigma=jnp.asarray(matte.sigma, dtype),
        edge_sigma=jnp.asarray(matte.edge_sigma, dtype),
        facts={name: jnp.array(fact) for name, fact in facts.items()},
        prior=prior,
        settings=settings,
        camera=camera,
        kernel=options.effort.kernel,
        max_steps=options.effort.max_steps,
    )


def _led(problem: OutlineProblem, start: AbstractBody) -> Traced:
    """Where a start leads to the edge."""
    to_edge = quickly_compiled(traced, static_argnames="to_end")
    return to_edge(problem, start, to_end=False)


def _assessed(
    problem: OutlineProblem, way: Traced, shape: tuple[int, ...]
) -> Assessment:
    """The solution that is near a body, and what is said of it.

    Args:
        problem: What was given.
        way: That led there.
        shape: Of the mask, which no compiled program knows.
    """
    found = quickly_compiled(_to_end)(problem, way)
    (residual,), (marks,) = found.residual, found.marks
    told = Pixelwise(residual, marks, problem.place, shape)
    return found._replace(fit=found.fit.having(pixelwise=(told,)))


def _to_end(problem: OutlineProblem, way: Traced) -> Assessment:
    found = traced(problem, way.body, to_end=True)
    steps = way.num_steps + found.num_steps
    return assess_outline(problem, found._replace(num_steps=steps))


def _loss(way: Traced) -> float:
    loss = float(way.loss)
    return loss if np.isfinite(loss) else np.inf


def _sized(body: AbstractBody, prior: Prior) -> AbstractBody:
    """A guess, as large or as far away as is expected; as it is where nothing is."""
    for name in ("radius", "height", "center"):
        belief = getattr(prior, name)
        if belief is not None and np.isfinite(belief[1]):
            wanted, own = (
                float(jnp.linalg.norm(x)) for x in (belief[0], getattr(body, name))
            )
            return _magnified(body, jnp.asarray(wanted / own, body.radius.dtype))
    return body


@jax.jit
def _magnified(body: AbstractBody, ratio: Float[Array, ""]) -> AbstractBody:
    return body.magnified(change_of(ratio))


@jax.jit
def _apart(first: AbstractBody, second: AbstractBody) -> Float[Array, ""]:
    """By how much two bodies are, or look, different, but for how large they are."""
    second = second.magnified(change_of(first.radius / second.radius))
    seen = jnp.zeros(len(first.ends), bool)
    own = first.readout(first, seen)

    def off(other: AbstractBody) -> Float[Array, ""]:
        read = other.readout(first, seen)
        parts = [
            jnp.max(jnp.abs(read[name] - own[name]))
            / (1 if name == "axis" else first.radius)
            for name in own
        ]
        return jnp.max(jnp.stack(parts))

    turned = second.reversed(-jnp.ones_like(second.radius))
    return jnp.minimum(off(second), off(turned))
