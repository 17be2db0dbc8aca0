"""The tables of the README from results.json."""

__all__ = ["COMPARED", "tables"]

from experiments.markdown import table
from experiments.recording import Results

COMPARED = (
    "radius",
    "height",
    "center_first",
    "center_second",
    "center_along",
    "axis_first",
    "axis_second",
)
"""Coordinates whose intervals are counted."""


def tables(results: Results) -> str:
    """Intervals by case, counts of videos, times, and what a camera drops."""
    values = results.values

    def number(name: str, factor: float = 1.0, digits: int = 1) -> str:
        value = values.get(name)
        return "-" if value is None else f"{factor * value:.{digits}f}"

    intervals = []
    for case in results.cases("intervals.", ".radius.inside"):
        inside = [number(f"{case}.{name}.inside", 100) for name in COMPARED]
        fall = number(f"{case}.radius.fall", digits=2)
        rms = number(f"{case}.radius.rms", 1e6)
        intervals.append([case.removeprefix("intervals."), rms, fall, *inside])
    counts = [
        [
            case.removeprefix("videos."),
            number(f"{case}.truths", digits=0),
            number(f"{case}.missed", 100),
            number(f"{case}.false", digits=0),
            number(f"{case}.switches", digits=0),
            number(f"{case}.mota", digits=3),
        ]
        for case in results.cases("videos.", ".mota")
    ]
    times = [
        [name, number(f"time.{name}.median"), number(f"time.{name}.slow")]
        for name in ("tracked", "searched", "find_cylinders")
    ]
    dropped = [
        [
            case.removeprefix("real_time."),
            number(f"{case}.dropped", 100),
            number(f"{case}.median"),
            number(f"{case}.slow"),
            number(f"{case}.missed", 100),
            number(f"{case}.switches", digits=0),
            number(f"{case}.aside", 1e6),
            number(f"{case}.speed", 1e3),
            number(f"{case}.radius", 1e6),
        ]
        for case in results.cases("real_time.", ".dropped")
    ]
    of_real_time = table(
        [
            "images taken",
            "dropped, %",
            "delay, ms",
            "99 %, ms",
            "not followed, %",
            "switches",
            "place: error, um",
            "velocity: error, mm/s",
            "std of radius, um",
        ],
        dropped,
    )
    kept = number("hidden.kept", 100)
    return "\n\n".join(
        [
            table(
                [
                    "case",
                    "radius: error, um",
                    "std, last over first",
                    *(f"{name}: 95 % that hold" for name in COMPARED),
                ],
                intervals,
            ),
            table(
                ["videos", "cylinders", "missed, %", "false", "switches", "MOTA"],
                counts,
            ),
            table(["image", "median, ms", "99 %, ms"], times),
            *([of_real_time] if dropped else []),
            f"Hidden for 20 images: {kept} % of the cans keep their identity.",
        ]
    )
