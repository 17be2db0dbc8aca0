"""What the first render in a new process takes; prints JSON.

`python -m experiments.render_speed.first_call SHRINK`
"""

__all__ = ["main"]

import json
import sys
import time


def main() -> None:
    """Time the import, the making of the arguments and the call, in milliseconds."""
    shrink = int(sys.argv[1])
    start = time.perf_counter()
    import jax

    import impostor_jax as ij

    render = ij.render
    imported = time.perf_counter()
    from experiments.scenes import make_can, make_view
    from experiments.timing import peak_memory_mb

    begun = time.perf_counter()
    can = jax.block_until_ready(make_can())
    camera = make_view(640 // shrink, 480 // shrink)
    ready = time.perf_counter()
    jax.block_until_ready(render(can, camera))
    done = time.perf_counter()
    record = {
        "import": 1e3 * (imported - start),
        "arguments": 1e3 * (ready - begun),
        "call": 1e3 * (done - ready),
        "memory": peak_memory_mb(),
    }
    print(json.dumps(record))


if __name__ == "__main__":
    main()
