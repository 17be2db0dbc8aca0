"""Time renders, gradients and fits, beside a kernel in C that does a render's work.

The kernel and the renderer are timed in turns, a block of calls each, so that both meet
the machine in one state and their ratio is fair.
"""

__all__ = ["Config", "run"]

import dataclasses
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import tyro

import impostor_jax as ij
from experiments.recording import Metric, result_folder, save_run
from experiments.render_speed.cases import (
    jax_cases,
    make_camera,
    make_can,
    make_many,
    noisy_image,
)
from experiments.render_speed.kernel import c_render
from experiments.render_speed.report import draw, table
from experiments.timing import (
    Timing,
    case_metrics,
    first_calls,
    sample,
    time_in_turns,
)
from impostor_jax.glsl.offscreen import DriverError, OffscreenRenderer
from impostor_jax.glsl.reference import draw_with_jax

HERE = Path(__file__).parent

SEED = 0

PROCESSES = 3
"""New processes in which a first call is timed."""

MANY = 10_000
"""Cylinders that are drawn at once, with OpenGL and with JAX."""

MANY_REPEATS = 3
"""Timed calls of these: the one in JAX takes many seconds."""

SLOW = ("fit_mask", "fit_no_mask", "first_fit", "scene_mixed", "scene_cylinders")
"""Cases that a quick run leaves out: they take 5 to 10 s to compile."""

FIRST_CALL = "experiments.render_speed.first_call"

FIRST = {"first_render": "render", "first_fit": "fit_cylinder"}
"""Cases that are timed in new processes, and the function that each calls."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how long renders, gradients and fits take."""

    quick: bool = False
    """Small image, few calls and no fits: a trial of the code, no measurement."""

    repeats: int = 200
    """Timed calls of each case."""

    output: Path | None = None
    """Folder of the results; the experiment's own by default, a temporary one with
    --quick."""


def measure(config: Config) -> list[Metric]:
    """Measure all cases."""
    shrink = 4 if config.quick else 1
    can, camera = make_can(), make_camera(shrink)
    depth = np.asarray(ij.render(can, camera).depth)
    image = noisy_image(depth, SEED)
    metrics: list[Metric] = []
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        frame: dict[str, Callable[[], object]] = {
            "frame_jax": lambda: ij.render(can, camera)
        }
        in_c = c_render(can, camera, depth, scratch)
        if in_c is not None:
            frame["frame_c"] = in_c
        timings = time_in_turns(frame, config.repeats)
        for case in ("frame_c", "frame_jax"):
            metrics += case_metrics(case, timings.get(case))
        ratios = (
            []
            if in_c is None
            else np.median(timings["frame_jax"].ms, axis=1)
            / np.median(timings["frame_c"].ms, axis=1)
        )
        metrics.append(sample("frame.ratio_of_jax_to_c", ratios, "1"))
        for case, call in jax_cases(can, camera, image).items():
            left_out = config.quick and case in SLOW
            timings = {} if left_out else time_in_turns({case: call}, config.repeats)
            metrics += case_metrics(case, timings.get(case))
        timings = time_many(camera, MANY // 100 if config.quick else MANY)
        for case in ("many_gl", "many_jax", "many_scene"):
            metrics += case_metrics(case, timings.get(case))
        np.save(scratch / "image.npy", image)
        for case, function in FIRST.items():
            processes = 1 if config.quick else PROCESSES
            if config.quick and case in SLOW:
                processes = 0
            arguments = [function, str(shrink), str(scratch / "image.npy")]
            records = first_calls(FIRST_CALL, arguments, processes)
            calls = np.array([[record["call"] for record in records]])
            metrics += case_metrics(case, Timing(calls))
            for name, unit in (
                ("import", "ms"),
                ("arguments", "ms"),
                ("memory", "MB"),
            ):
                values = [record[name] for record in records]
                metrics.append(sample(f"{case}.{name}", values, unit))
    return metrics


def time_many(camera: ij.PinholeCamera, count: int) -> dict[str, Timing]:
    """Time many cylinders at once; without OpenGL only in JAX."""
    cylinders = make_many(count, SEED)
    scene, outputs = ij.Scene([cylinders]), ("depth", "normal", "index")
    calls: dict[str, Callable[[], object]] = {
        "many_jax": lambda: draw_with_jax(cylinders, camera).depth,
        "many_scene": lambda: ij.render(scene, camera, outputs),
    }
    try:
        renderer = OffscreenRenderer()
    except DriverError:
        return time_in_turns(calls, MANY_REPEATS, warm_up=1)
    with renderer:
        calls["many_gl"] = lambda: renderer.draw(cylinders, camera).depth
        return time_in_turns(calls, MANY_REPEATS, warm_up=1)


def run(config: Config) -> Path:
    """Measure, record and draw; returns the folder of the results.

    Raises:
        ValueError: `repeats` is not positive, or the code is not committed.
    """
    if config.repeats < 1:
        raise ValueError(f"repeats must be at least 1, got {config.repeats}")
    folder = result_folder(config.output, HERE, quick=config.quick)
    if config.quick:
        config = dataclasses.replace(config, repeats=min(config.repeats, 4))
    start = time.perf_counter()
    metrics = measure(config)
    save_run(
        folder,
        metrics,
        config,
        seed=SEED,
        dtype=str(make_can().radius.dtype),
        seconds=time.perf_counter() - start,
        quick=config.quick,
    )
    draw(folder)
    return folder


if __name__ == "__main__":
    try:
        written = run(tyro.cli(Config))
    except ValueError as error:
        sys.exit(str(error))
    print(f"{table(written)}\n\nwritten to {written}")
