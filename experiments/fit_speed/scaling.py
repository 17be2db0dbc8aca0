"""How the time of a fit grows with pixels, images and free parameters."""

__all__ = ["FEW", "MANY", "Sizes", "scaling_metrics"]

import dataclasses
from collections.abc import Callable, Iterator, Mapping

import numpy as np

import impostor_jax as ij
from experiments.fit_speed.cases import View, fit_one, fit_several, see_can, time_fits
from experiments.recording import Metric
from experiments.timing import case_metrics, growth


@dataclasses.dataclass(frozen=True)
class Sizes:
    """What is varied.

    Attributes:
        scales: Rows and columns of the image, in those of 640x480.
        images: Of a batch.
        fixed: Parameters that are held, by the number of coordinates that are free.
    """

    scales: tuple[float, ...]
    images: tuple[int, ...]
    fixed: dict[int, tuple[str, ...]]


MANY = Sizes(
    scales=(0.25, 0.5, 1.0, 2.0, 3.0),
    images=(1, 2, 4, 8, 16, 32, 64),
    fixed={
        7: (),
        6: ("radius",),
        5: ("radius", "height"),
        4: ("center",),
        2: ("center", "radius", "height"),
    },
)
"""Each scale and each choice of parameters but the first needs a program of its own."""

FEW = Sizes(scales=(0.25,), images=(1, 2), fixed={7: ()})
"""All by one program."""

WARM_UP = 1


def scaling_metrics(view: View, sizes: Sizes, repeats: int) -> Iterator[Metric]:
    """Times and exponents of balanced fits with a mask.

    Args:
        view: As many images as the largest batch has.
        sizes: What is varied.
        repeats: Timed calls of each size.
    """
    views = [see_can(scale, 1) for scale in sizes.scales]
    pixels = {int(np.count_nonzero(seen.mask)): seen for seen in views}
    guessed = {n: lambda v=seen: fit_one(v) for n, seen in pixels.items()}
    yield from curve_metrics("pixels", guessed, repeats)
    given = {n: lambda v=seen: fit_one(v, initial=v.can) for n, seen in pixels.items()}
    yield from curve_metrics("pixels_from_start", given, repeats)
    parts = {count: view.first(count) for count in sizes.images}
    by_images = {n: lambda v=part: fit_several(v) for n, part in parts.items()}
    yield from curve_metrics("images", by_images, repeats)
    by_parameters = {
        free: lambda f=fixed: fit_one(view, initial=view.can, fixed=f)
        for free, fixed in sizes.fixed.items()
    }
    yield from curve_metrics("parameters", by_parameters, repeats)


def curve_metrics(
    name: str, calls: Mapping[int, Callable[[], ij.Fit]], repeats: int
) -> Iterator[Metric]:
    """Time of a call at each size, all in turns, and the exponent of their medians."""
    named = {str(size): call for size, call in calls.items()}
    timings = time_fits(named, repeats, WARM_UP)
    for size, timing in timings.items():
        yield from case_metrics(f"scaling.{name}.{size}", timing)
    medians = [float(np.median(timings[size].ms)) for size in named]
    yield growth(f"scaling.{name}.exponent", list(calls), medians)
