"""Other programs' fits of a cylinder to the same pixels, where they are installed."""

__all__ = ["NAMES", "peer_metrics"]

import importlib.util
import json
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float

from experiments.fit_speed.cases import View, fit_one
from experiments.recording import Metric
from experiments.scenes import SIGMA
from experiments.timing import Timing, case_metrics, time_in_turns

NAMES = ("pcl", "scipy", "cylfit", "scikit-spatial", "pyransac3d")

REPEATS = 3
"""Timed calls of each: some take seconds."""

PYTHON_OF_PCL = "/usr/bin/python3"
"""Where Debian installs the binding of PCL."""


def peer_metrics(view: View) -> Iterator[Metric]:
    """Time of each program, and its error of the radius beside that of our fit."""
    radii: dict[str, float | None] = {}
    timings: dict[str, Timing] = {}
    if importlib.util.find_spec("cylfit") is not None:
        from experiments.fit_accuracy.peers import PEERS, points_of

        def points() -> Float[np.ndarray, "n 3"]:
            return points_of(view.depths[0], view.mask, view.camera)

        calls: dict[str, Callable[[], float]] = {
            name: lambda f=function: f(points(), SIGMA, view.can)[2]
            for name, function in PEERS.items()
        }
        radii |= {name: call() for name, call in calls.items()}
        timings |= time_in_turns(calls, REPEATS, warm_up=0)
        in_pcl = _fit_by_pcl(points(), float(view.can.radius))
        if in_pcl is not None:
            radii["pcl"], timings["pcl"] = in_pcl
    for name in NAMES:
        yield from case_metrics(f"peer.{name}", timings.get(name))
    radii["balanced"] = float(fit_one(view).cylinder.radius)
    for name in (*NAMES, "balanced"):
        found = radii.get(name)
        value = None if found is None else 1e3 * abs(found - float(view.can.radius))
        yield Metric(f"peer.{name}.radius_error", value, None, "mm", "lower", 1)


def _fit_by_pcl(
    points: Float[np.ndarray, "n 3"], radius: float
) -> tuple[float | None, Timing] | None:
    """Radius and times, in a process of its own; None where there is no binding."""
    script = Path(__file__).with_name("pcl_fit.py")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "points.npy"
        np.save(path, points)
        arguments = map(str, (script, path, SIGMA, radius, REPEATS))
        try:
            # -I: without this environment's packages.
            done = subprocess.run(
                [PYTHON_OF_PCL, "-I", *arguments],
                capture_output=True,
                text=True,
                check=True,
            )
        except (OSError, subprocess.CalledProcessError) as error:
            print(f"PCL is left out: {error}")
            return None
    record = json.loads(done.stdout)
    return record["radius"], Timing(np.array([record["ms"]]))
