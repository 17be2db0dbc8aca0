"""What the first call in a new process takes; prints JSON.

`python -m experiments.render_speed.first_call FUNCTION SHRINK IMAGE`, where FUNCTION is
render or fit_cylinder, and IMAGE a .npy file that holds the depth image to fit.
"""

__all__ = ["main"]

import json
import sys
import time


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
    from experiments.timing import peak_memory_mb

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


if __name__ == "__main__":
    main()
