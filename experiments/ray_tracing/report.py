"""The tables of the README, from results.json."""

__all__ = ["tables"]

from experiments.markdown import number, percent, table
from experiments.recording import Results


def tables(results: Results) -> str:
    """Own surfaces, the published scene, many shapes, and edges once measured."""
    parts = (_own, _error, _beside, _time, _many, _edges)
    return "\n\n".join(drawn for part in parts if (drawn := part(results)))


def _own(results: Results) -> str:
    rows = []
    for case in results.cases("own.", ".none"):
        distance = case.removeprefix("own.")
        parts = [results.values[f"{case}.{name}"] for name in COLUMNS]
        rows.append([f"{float(distance):g}", *(percent(part) for part in parts)])
    return table(["distance in sizes", *COLUMNS.values()], rows)


COLUMNS = {
    "by rounding": "moved by the rounding",
    "0.001": "moved by 0.001 m",
    "none": "not moved",
}


def _error(results: Results) -> str:
    rows = [
        [
            case.removeprefix("error."),
            *(number(results.values[f"{case}.{q}"]) for q in QS),
        ]
        for case in results.cases("error.", ".p50")
    ]
    return table(["error over the peak, off the edges", "median", "90 %", "99 %"], rows)


QS = ("p50", "p90", "p99")


def _beside(results: Results) -> str:
    rows = [
        [
            case.removeprefix("beside."),
            *(
                number(results.values[f"{case}.p{q}"])
                for q in ("50", "90", "99", "99.9")
            ),
        ]
        for case in results.cases("beside.", ".p50")
    ]
    header = ["beside, over the peak, off the edges", "median", "90 %", "99 %"]
    return table([*header, "99.9 %"], rows)


def _time(results: Results) -> str:
    one = results.values["sampling.1 ray.time"]
    rows = []
    for case in results.cases("sampling.", ".time"):
        ms, spread = results.pair(f"{case}.time")
        rmse, alike = (results.values.get(f"{case}.{of}") for of in ("rmse", "ssim"))
        off = number(rmse), number(None if alike is None else 1 - alike)
        name = case.removeprefix("sampling.")
        rows.append([name, number(ms, ".3g", spread), number(ms / one, ".2f"), *off])
    head = ["rays of a pixel", "ms (spread)", "over 1 ray", "RMSE", "1 - SSIM"]
    return table(head, rows)


def _many(results: Results) -> str:
    kinds = ("balls.first", "balls.blocked", "cans.first", "cans.blocked")
    rows = []
    for case in results.cases("many.", ".balls.first.JAX.time"):
        for program in ("JAX", "Mitsuba", "Open3D"):
            times = [results.pair(f"{case}.{kind}.{program}.time") for kind in kinds]
            if any(ms is not None for ms, _ in times):
                cells = [number(ms, ".3g", spread) for ms, spread in times]
                rows.append([case.removeprefix("many."), program, *cells])
    names = (kind.replace(".", ", ") for kind in kinds)
    return table(["shapes", "ms (spread)", *names], rows)


def _edges(results: Results) -> str:
    rows = []
    for case in results.cases("edges.", ".gradient"):
        _, scene, side = case.split(".")
        off = percent(results.values[f"{case}.gradient"])
        ms, spread = results.pair(f"{case}.time")
        over = ms / results.values[f"edges.{scene}.hard.time"]
        rmse = number(results.values[f"{case}.rmse"])
        cost = [number(ms, ".3g", spread), number(over, ".2f")]
        rows.append([scene, side, off, rmse, *cost])
    head = ["edge", "drawn", "gradient off by", "RMSE", "ms (spread)", "over hard"]
    return table(head, rows) if rows else ""
