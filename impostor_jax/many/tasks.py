"""What is done on an image or a cloud: a search or a fit, its rows and its files."""

__all__ = [
    "FITS",
    "NOTHING",
    "AbstractTask",
    "FindTask",
    "FitTask",
    "Row",
    "Tests",
    "write_fit",
]

import abc
import dataclasses
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from typing_extensions import override

from impostor_jax.effort import Effort
from impostor_jax.find.cylinders import find_cylinders
from impostor_jax.find.found import AbstractFound, Found, FoundInPoints
from impostor_jax.fit.bore import BoreTest, test_bore
from impostor_jax.fit.record import estimate_record, numbers
from impostor_jax.fit.result import Fit
from impostor_jax.fit.taper import TaperTest, test_taper
from impostor_jax.fits.labels import fit_labels
from impostor_jax.fits.points import fit_cylinder_to_points
from impostor_jax.fits.search_points import find_cylinders_in_points
from impostor_jax.fits.single import (
    fit_box,
    fit_cylinder,
    fit_frustum,
    fit_sphere,
    fit_tube,
)
from impostor_jax.io.atomic import write_json
from impostor_jax.io.depth_image import write_index
from impostor_jax.io.npy_file import write_npy
from impostor_jax.io.record import found_in_points_record, found_record
from impostor_jax.io.sensor_record import sensor_record
from impostor_jax.io.shape_record import shape_record
from impostor_jax.io.tables import columns_of
from impostor_jax.many.items import Shown
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.viewer.figure import write_overlay

Row = dict[str, Any]
"""A line of the table, by column."""

NOTHING = "nothing_found"
"""Status of an image in which there is no cylinder."""

FITS: dict[str, Callable[..., Fit]] = {
    "cylinder": fit_cylinder,
    "sphere": fit_sphere,
    "frustum": fit_frustum,
    "tube": fit_tube,
    "box": fit_box,
}
"""By the name of what is fitted."""


@dataclasses.dataclass(frozen=True)
class AbstractTask(abc.ABC):
    """What is done on each item, alike on all.

    Attributes:
        options: Of the search or the fit, by name; `sigma` among them.
    """

    options: Mapping[str, Any]

    @abc.abstractmethod
    def done_on(self, shown: Shown, place: Path | None) -> list[Row]:
        """Rows of what is found or fitted.

        Args:
            shown: An image or a cloud.
            place: Folder that its files are written to; None if none are.

        Raises:
            ValueError: What is shown cannot be searched or fitted.
        """

    def of_cloud(self, shown: Shown) -> dict[str, Any]:
        """The options, with where a cloud's file says that the sensor stood."""
        known = {} if shown.origin is None else {"origin": shown.origin}
        return {**self.options, **known}

    def told(self) -> dict[str, Any]:
        """What it depends on, as JSON can hold it."""
        return {
            "task": type(self).__name__,
            **{name: _told_of(value) for name, value in self.options.items()},
        }


@dataclasses.dataclass(frozen=True)
class FindTask(AbstractTask):
    """Every cylinder is looked for."""

    @override
    def done_on(self, shown: Shown, place: Path | None) -> list[Row]:
        found, seconds = self.found_in(shown)
        if place is not None:
            self.write(found, shown, seconds, place)
        if not found:
            why = "No cylinder was found."
            return [{"status": NOTHING, "reason": why, "seconds": seconds}]
        return [
            _row(
                fit,
                k + 1,
                {
                    "confidence": numbers(found.confidence[k]),
                    "visible": numbers(found.visible[k]),
                    "inside": bool(found.inside[k]),
                    **estimate_record(fit),
                },
                seconds,
            )
            for k, fit in enumerate(found)
        ]

    def found_in(self, shown: Shown) -> tuple[AbstractFound, float]:
        """What is found, and the seconds that it took."""
        start = time.perf_counter()
        if shown.points is not None:
            found = find_cylinders_in_points(shown.points, **self.of_cloud(shown))
        else:
            found = find_cylinders(shown.depth, shown.camera, **self.options)
        return found, time.perf_counter() - start

    def write(
        self,
        found: AbstractFound,
        shown: Shown,
        seconds: float,
        place: Path,
        record: Path | None = None,
    ) -> None:
        """Write the files of a search, the record last.

        Args:
            found: What was found.
            shown: In what.
            seconds: That it took.
            place: Folder of the files.
            record: File of the record instead of one in that folder.
        """
        made_from = self.told()
        if isinstance(found, FoundInPoints):
            write_npy(place / "labels.npy", np.asarray(found.labels))
            told = found_in_points_record(found, seconds, made_from)
        else:
            assert isinstance(found, Found)
            write_index(place / "labels.png", found.labels - 1)
            write_overlay(place / "overlay.png", found, shown.depth, shown.camera)
            told = found_record(found, shown.camera, seconds, made_from)
        write_json(record or place / "found.json", told)


Tests = tuple[TaperTest | None, BoreTest | None]
"""Whether a frustum, or a tube, is needed; None where that is not asked."""


@dataclasses.dataclass(frozen=True)
class FitTask(AbstractTask):
    """One shape is fitted, or one to each of the objects that are labeled.

    Attributes:
        shape: Which, a name of `FITS`.
        test_taper: Whether a frustum is tested against a cylinder.
        test_bore: Whether a tube is.
    """

    shape: str = "cylinder"
    test_taper: bool = False
    test_bore: bool = False

    @override
    def done_on(self, shown: Shown, place: Path | None) -> list[Row]:
        fits, seconds = self.fits_of(shown)
        rows = []
        for label, fit in fits.items():
            tests = self.tests_of(fit)
            if place is not None:
                folder = place if label is None else place / f"label_{label}"
                write_fit(fit, tests, shown, seconds, folder)
            needed = {
                name: None if test is None else bool(test.is_needed())
                for name, test in zip(("taper", "bore"), tests, strict=True)
                if getattr(self, f"test_{name}")
            }
            rows.append(_row(fit, label, estimate_record(fit), seconds) | needed)
        return rows

    def fits_of(self, shown: Shown) -> tuple[Mapping[Any, Fit], float]:
        """Fits by label, None of what has none; and the seconds that they took."""
        labels, function = shown.labels, FITS[self.shape]
        start = time.perf_counter()
        options = dict(self.options)
        if shown.points is not None:
            if self.shape != "cylinder":
                raise ValueError(f"shape must be cylinder of a cloud, got {self.shape}")
            options = self.of_cloud(shown)
            fits = {None: fit_cylinder_to_points(shown.points, **options)}
        elif isinstance(labels, np.ndarray) and labels.dtype != bool:
            fits = fit_labels(shown.depth, shown.camera, labels, function, **options)
        else:
            fits = {None: function(shown.depth, shown.camera, labels, **options)}
        return fits, time.perf_counter() - start

    def tests_of(self, fit: Fit) -> Tests:
        """What is asked beside a fit, where an object was seen."""
        is_tested = fit.asked.arguments is not None
        return (
            test_taper(fit) if self.test_taper and is_tested else None,
            test_bore(fit) if self.test_bore and is_tested else None,
        )

    @override
    def told(self) -> dict[str, Any]:
        tests = {"test_taper": self.test_taper, "test_bore": self.test_bore}
        return super().told() | {"shape": self.shape} | tests


def write_fit(
    fit: Fit,
    tests: Tests,
    shown: Shown,
    seconds: float,
    place: Path,
    record: Path | None = None,
) -> None:
    """Write the files of a fit, the record last.

    Args:
        fit: To an image or a cloud.
        tests: Of it.
        shown: What it was made to.
        seconds: That it took.
        place: Folder of the files.
        record: File of the record instead of one in that folder.
    """
    if isinstance(shown.depth, np.ndarray):
        write_overlay(place / "overlay.png", fit, shown.depth, shown.camera)
    write_json(record or place / "fit.json", fit.to_dict(seconds, *tests))


def _row(fit: Fit, label: int | None, values: dict[str, Any], seconds: float) -> Row:
    """The row of a cylinder.

    Args:
        fit: Of it.
        label: Its number in the image; None of a single one.
        values: What is told of it by name, as records have it.
        seconds: Of the image.
    """
    return {
        "object": label,
        "success": bool(fit.success),
        "status": str(fit.status),
        "reason": fit.reason,
        **columns_of(values),
        "num_pixels": int(fit.num_pixels),
        "rms_m": numbers(fit.rms),
        "chi2": numbers(fit.chi2),
        "covariance": numbers(np.ravel(fit.covariance)),
        "seconds": seconds,
    }


def _told_of(value: Any) -> Any:
    """An option, as JSON can hold it."""
    if isinstance(value, AbstractDepthNoise):
        return sensor_record(value)
    if isinstance(value, AbstractPrimitive):
        return shape_record(value)
    if isinstance(value, Effort):
        return dataclasses.asdict(value)
    if isinstance(value, Mapping):
        return {name: _told_of(part) for name, part in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value
