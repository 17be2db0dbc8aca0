"""What the first call in a new process takes; prints JSON.

`python -m experiments.render_speed.first_call FUNCTION SHRINK IMAGE`, where FUNCTION is
render or fit_cylinder, and IMAGE a .npy file that holds the depth image to fit.
"""

__all__ = ["main", "peak_memory_mb"]

import json
import sys
import time
from pathlib import Path


def main() -> None:
    """Time the import, the making of the arguments and the call, in milliseconds."""
    function, shrink, image = sys.argv[1], int(sys.argv[2]), sys.argv[3]
    start = time.perf_counter()
    import jax
    import numpy as np

    import impostor_jax as ij

    called = getattr(ij, function)
    imported = time.perf_counter()
    from experiments.render_speed.cases import SIGMA, make_camera, make_can

    camera = make_camera(shrink)
    if function == "render":
        arguments = {"primitive": jax.block_until_ready(make_can())}
    else:
        arguments = {"depth": np.load(image), "sigma": SIGMA}
    ready = time.perf_counter()
    jax.block_until_ready(called(camera=camera, **arguments))
    done = time.perf_counter()
    record = {
        "import": 1e3 * (imported - start),
        "arguments": 1e3 * (ready - imported),
        "call": 1e3 * (done - ready),
        "memory": peak_memory_mb(),
    }
    print(json.dumps(record))


def peak_memory_mb() -> float | None:
    """Largest resident memory of this process; None where there is no /proc.

    Not `ru_maxrss`: it outlives the fork and the exec that started this process, and
    would tell the peak of the parent.
    """
    status = Path("/proc/self/status")
    for line in status.read_text().splitlines() if status.exists() else ():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024 / 1e6
    return None


if __name__ == "__main__":
    main()
