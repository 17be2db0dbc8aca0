"""Other programs' fits of a cylinder to the same pixels, where they are installed."""

__all__ = ["NAMES", "peer_metrics"]

import importlib
import importlib.util
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from jaxtyping import Float

import impostor_jax as ij
from experiments.fit_speed.cases import View, fit_one
from experiments.recording import Metric
from experiments.render_speed.cases import SIGMA
from experiments.timing import case_metrics, time_in_turns

NAMES = ("pcl", "scipy", "cylfit", "scikit-spatial", "pyransac3d")

REPEATS = 3
"""Timed calls of each: some take seconds."""

NEIGHBORS = 50
"""Points from which PCL takes a normal."""


def peer_metrics(view: View) -> Iterator[Metric]:
    """Time of each program, and its error of the radius beside that of our fit."""
    calls = peer_calls(view)
    radii = {name: call() for name, call in calls.items()}
    timings = time_in_turns(calls, REPEATS, warm_up=0)
    for name in NAMES:
        yield from case_metrics(f"peer.{name}", timings.get(name))
    radii["balanced"] = float(fit_one(view).cylinder.radius)
    for name in (*NAMES, "balanced"):
        off = abs(radii[name] - float(view.can.radius)) if name in radii else np.inf
        value = 1e3 * off if np.isfinite(off) else None
        yield Metric(f"peer.{name}.radius_error", value, None, "mm", "lower", 1)


def peer_calls(view: View) -> dict[str, Callable[[], float]]:
    """Fits that return a radius in meters, from the image to the cylinder."""
    if importlib.util.find_spec("cylfit") is None:
        return {}
    from experiments.fit_accuracy.peers import PEERS, points_of

    def points() -> Float[np.ndarray, "n 3"]:
        return points_of(view.depths[0], view.mask, view.camera)

    calls: dict[str, Callable[[], float]] = {
        name: lambda f=function: f(points(), SIGMA, view.can)[2]
        for name, function in PEERS.items()
    }
    if importlib.util.find_spec("pcl") is not None:
        calls["pcl"] = lambda: _pcl(points(), view.can)
    return calls


def _pcl(points: Float[np.ndarray, "n 3"], truth: ij.Cylinder) -> float:
    """PCL's search for samples with normals, and the refined cylinder of the best."""
    pcl: Any = importlib.import_module("pcl")
    cloud = pcl.PointCloud()
    cloud.from_array(points.astype(np.float32))
    search = cloud.make_segmenter_normals(ksearch=NEIGHBORS)
    search.set_optimize_coefficients(True)
    search.set_model_type(pcl.SACMODEL_CYLINDER)
    search.set_method_type(pcl.SAC_RANSAC)
    search.set_normal_distance_weight(0.1)
    search.set_max_iterations(1000)
    search.set_distance_threshold(3 * SIGMA)
    search.set_radius_limits(0.0, 2 * float(truth.radius))
    _, model = search.segment()
    # A point, the axis and the radius; nothing where no cylinder was found.
    return float(model[6]) if len(model) == 7 else np.inf
