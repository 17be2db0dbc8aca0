"""What is written of a comparison: a record, a table, and a picture of each case."""

__all__ = ["write_parity"]

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from impostor_jax.glsl.conventions import DrawnMaps
from impostor_jax.io.atomic import write_atomically, write_json, write_text
from impostor_jax.numerics import eps
from impostor_jax.opencv import cv2
from impostor_jax.parity.run import Row
from impostor_jax.parity.traced import TracedRow

ZOOM = 3
"""Side of an image pixel in a picture."""

WORST_ULP = 1024
"""Difference that a picture shows in its last color."""


def write_parity(folder: Path, name: str, rows: Sequence[Row | TracedRow]) -> None:
    """Write parity.json, parity.md and a picture of each case."""
    write_json(
        folder / "parity.json",
        {
            "driver": name,
            "holds": all(row.holds for row in rows),
            "cases": [_record(row) for row in rows],
        },
    )
    drawn = [row for row in rows if isinstance(row, Row)]
    traced = [row for row in rows if isinstance(row, TracedRow)]
    tables = [_table(name, drawn)] if drawn else []
    tables += [_traced_table(name, traced)] if traced else []
    write_text(folder / "parity.md", "\n".join(tables))
    for row in rows:
        picture, file = _picture(row), re.sub(r"[^a-z0-9.]+", "_", row.case.name)
        write_atomically(
            folder / f"{file}.png",
            lambda path, picture=picture: cv2.imwrite(str(path), picture),
        )


def _record(row: Row | TracedRow) -> dict[str, object]:
    common = {
        "case": row.case.name,
        "count": row.case.count,
        "holds": row.holds,
        "verdicts": [dataclasses.asdict(verdict) for verdict in row.verdicts],
    }
    if isinstance(row, TracedRow):
        return {
            **common,
            "num_hits": row.num_hits,
            "num_edges": row.num_edges,
            "color": dataclasses.asdict(row.color),
        }
    return {
        **common,
        **dataclasses.asdict(row.found),
        "depth": dataclasses.asdict(row.depth),
        "normal": dataclasses.asdict(row.normal),
    }


def _table(name: str, rows: Sequence[Row]) -> str:
    lines = [
        f"# Parity of JAX with {name}",
        "",
        "Flips: pixels that see another primitive, or none, on the band one pixel to "
        "each side of an edge, and off it. Depth and normals where both see the same; "
        "conditioned: over eps times the condition number.",
        "",
        "| case | hits | band | flips on | flips off | part flips "
        "| depth, m: median | worst | ulp: median | 99 % | worst "
        "| conditioned: 99 % | worst | normal, deg: median | 99.9 % | worst "
        "| conditioned: worst | holds |",
        "|---|" + "--:|" * 16 + "---|",
    ]
    for row in rows:
        found = row.found
        meters, ulp, angle = found.depth_m, found.depth_ulp, found.normal_deg
        numbers = (
            found.num_hits, found.num_band, found.flips_on_band, found.flips_off_band,
            found.part_flips, meters.median, meters.worst, ulp.median, ulp.p99,
            ulp.worst, row.depth.p99, row.depth.worst, angle.median, angle.p999,
            angle.worst, row.normal.worst,
        )  # fmt: skip
        lines.append(_line(row, numbers))
    return "\n".join(lines) + "\n"


def _traced_table(name: str, rows: Sequence[TracedRow]) -> str:
    lines = [
        f"# Parity of JAX's traced pictures with {name}",
        "",
        "Colors where all pixels around see the same, mirrored or through glass, too.",
        "",
        "| case | hits | edges | color: median | 99 % | 99.9 % | worst | holds |",
        "|---|" + "--:|" * 6 + "---|",
    ]
    for row in rows:
        color = row.color
        lines.append(_line(row, (
            row.num_hits, row.num_edges, color.median, color.p99, color.p999,
            color.worst,
        )))  # fmt: skip
    return "\n".join(lines) + "\n"


def _line(row: Row | TracedRow, numbers: Sequence[float]) -> str:
    """A case's line of a table."""
    broken = [v.quantity for v in row.verdicts if not v.holds]
    holds = f"no: {', '.join(broken)}" if broken else "yes"
    cells = " | ".join(f"{value:.3g}" for value in numbers)
    return f"| {row.case.name} | {cells} | {holds} |"


def _picture(row: Row | TracedRow) -> UInt8[np.ndarray, "h w 3"]:
    """JAX, the driver and their difference, side by side."""
    if isinstance(row, TracedRow):
        return _traced_picture(row)
    return _drawn_picture(row)


def _traced_picture(row: TracedRow) -> UInt8[np.ndarray, "h w 3"]:
    apart = np.abs(row.drawn - row.reference).max(axis=-1) / eps(np.float32)
    panels = [
        _labeled(_display(row.reference), "JAX"),
        _labeled(_display(row.drawn), "OpenGL"),
        _labeled(_shaded(apart), f"color apart, 0 to {WORST_ULP} eps"),
    ]
    return np.concatenate(panels, axis=1)


def _display(color: Float[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """Linear RGB as a display wants it, in OpenCV's order of channels."""
    clipped = np.clip(color[..., ::-1], 0, 1)
    return (255 * clipped ** (1 / 2.2)).astype(np.uint8)


def _shaded(apart: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """Colors of differences, from 0 to `WORST_ULP`."""
    scaled = np.log2(1 + apart) / np.log2(1 + WORST_ULP)
    shade = np.clip(255 * scaled, 0, 255).astype(np.uint8)
    return cv2.applyColorMap(shade, cv2.COLORMAP_VIRIDIS)


def _drawn_picture(row: Row) -> UInt8[np.ndarray, "h w 3"]:
    same = row.reference.mask & (row.reference.index == row.drawn.index)
    true = np.where(same, row.reference.depth, 1).astype(np.float32)
    apart = np.abs(np.where(same, row.drawn.depth, 1) - true) / np.spacing(true)
    difference = _shaded(apart)
    difference[~same] = 255
    difference[row.reference.index != row.drawn.index] = (0, 0, 255)
    panels = [
        _labeled(_colors(row.reference), "JAX"),
        _labeled(_colors(row.drawn), "OpenGL"),
        _labeled(difference, f"depth apart, 0 to {WORST_ULP} ulp; red: flips"),
    ]
    return np.concatenate(panels, axis=1)


def _colors(maps: DrawnMaps) -> UInt8[np.ndarray, "h w 3"]:
    """Normals as colors on white, in OpenCV's order of channels."""
    colors = np.where(maps.mask[..., None], 127.5 * (1 - maps.normal[..., ::-1]), 255.0)
    return np.clip(colors, 0, 255).astype(np.uint8)


def _labeled(
    image: UInt8[np.ndarray, "h w 3"], label: str
) -> UInt8[np.ndarray, "h2 w2 3"]:
    size = (ZOOM * image.shape[1], ZOOM * image.shape[0])
    large = cv2.resize(image, size, interpolation=cv2.INTER_NEAREST)
    large = cv2.copyMakeBorder(
        large, 24, 4, 4, 4, cv2.BORDER_CONSTANT, value=(255, 255, 255)
    )
    font, black = cv2.FONT_HERSHEY_SIMPLEX, (0, 0, 0)
    return cv2.putText(large, label, (6, 17), font, 0.5, black, 1, cv2.LINE_AA)
