"""What the first fit in a new process takes, and where that goes; prints JSON.

`python -m experiments.fit_speed.first_call EFFORT VIEW`, where VIEW is a .npz file of
the depths, one image or several, the mask or masks, sigma, and the six numbers of the
camera.
"""

__all__ = ["main"]

import json
import sys
import time

EVENTS = {
    "trace": "/jax/core/compile/jaxpr_trace_duration",
    "lower": "/jax/core/compile/jaxpr_to_mlir_module_duration",
    "compile": "/jax/core/compile/backend_compile_duration",
}
"""What JAX reports of its work; a program that is loaded counts as compiled."""

Span = tuple[float, float]


def covered(spans: list[Span]) -> float:
    """Length of the union of intervals: a function is traced inside another."""
    total, reached = 0.0, float("-inf")
    for start, stop in sorted(spans):
        total += max(stop - max(start, reached), 0.0)
        reached = max(reached, stop)
    return total


def main() -> None:
    """Time imports, the making of the arguments and the call, in milliseconds."""
    effort, view = sys.argv[1:]
    start = time.perf_counter()
    import jax
    import jax.monitoring
    import numpy as np

    jax_imported = time.perf_counter()
    import impostor_jax as ij

    fits = {2: ij.fit_cylinder, 3: ij.fit_cylinders}
    imported = time.perf_counter()
    loaded = np.load(view)
    depth, mask, sigma = loaded["depth"], loaded["mask"], float(loaded["sigma"])
    fx, fy, cx, cy, width, height = loaded["camera"]
    camera = ij.PinholeCamera(fx, fy, cx, cy, int(width), int(height))
    ready = time.perf_counter()
    spans: dict[str, list[Span]] = {event: [] for event in EVENTS.values()}

    def listen(event: str, start_time: float, end_time: float, **_: object) -> None:
        if event in spans:
            spans[event].append((start_time, end_time))

    jax.monitoring.register_event_time_span_listener(listen)
    fit = fits[depth.ndim](depth, camera, mask, sigma, effort=effort)
    jax.block_until_ready(fit)
    done = time.perf_counter()
    # Not before: it would import what the call has to.
    from experiments.timing import peak_memory_mb

    if not np.all(fit.success):
        raise ValueError("a fit that is timed must succeed, got a failure")
    stats = jax.devices()[0].memory_stats()
    record = {
        "import_jax": 1e3 * (jax_imported - start),
        "import": 1e3 * (imported - jax_imported),
        "arguments": 1e3 * (ready - imported),
        "call": 1e3 * (done - ready),
        "without_jax": 1e3 * (done - jax_imported),
        **{part: 1e3 * covered(spans[event]) for part, event in EVENTS.items()},
        "memory": peak_memory_mb(),
        "device_memory": stats["peak_bytes_in_use"] / 1e6 if stats else None,
    }
    print(json.dumps(record))


if __name__ == "__main__":
    main()
