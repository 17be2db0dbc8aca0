"""The tables of the README, from results.json."""

__all__ = ["tables"]

from experiments.columns import Column, case_table, without_group
from experiments.markdown import number, percent, table
from experiments.recording import Results

OWN = (
    Column("moved by the rounding", "by rounding", percent),
    Column("moved by 0.001 m", "0.001", percent),
    Column("not moved", "none", percent),
)

ERRORS = Column("median", "p50"), Column("90 %", "p90"), Column("99 %", "p99")


def tables(results: Results) -> str:
    """Own surfaces, the published scene, many shapes, and edges once measured."""
    own, error, beside = (
        results.cases(f"{group}.", end)
        for group, end in (("own", ".none"), ("error", ".p50"), ("beside", ".p50"))
    )
    head, far = "over the peak, off the edges", (*ERRORS, Column("99.9 %", "p99.9"))
    blocks = [
        case_table(results, "distance in sizes", own, OWN, _distance),
        case_table(results, f"error {head}", error, ERRORS, without_group),
        case_table(results, f"beside, {head}", beside, far, without_group),
        _time(results),
        _many(results),
    ]
    if edges := _edges(results):
        blocks.append(edges)
    return "\n\n".join(blocks)


def _distance(case: str) -> str:
    return f"{float(without_group(case)):g}"


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
