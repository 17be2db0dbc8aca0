"""Derive the weights of the confidence from detections in clouds of other seeds.

After a change of what is found, or of the facts, run this again until the weights stay.
"""

__all__ = ["Config"]

import dataclasses
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Float

from experiments.find_accuracy.calibrate import Judged, summary_of, weights_text
from experiments.find_clouds.scenes import KINDS, draw_cloud
from impostor_jax.caching import keep_compiled
from impostor_jax.clouds.confidence import FACTS
from impostor_jax.clouds.search import Request
from impostor_jax.fits.given_points import points_given
from impostor_jax.fits.search_points import search_cloud
from impostor_jax.matching import LEVELS, detection_of, match

SEED = 7000
"""Of the first cloud; none that is reported is near."""

REQUEST = Request(least_sure=0.002)
"""What is looked for, and most of what is left out by default."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Derive the weights of `impostor_jax/clouds/confidence.py`."""

    count: int = 40
    """Clouds of each kind."""
    workers: int = 2
    """Processes that search them."""
    kept: Path | None = None
    """File for the facts, NPZ: read if it is there."""


def derive(config: Config) -> str:
    """Search clouds of all kinds, and tell the weights and how good they are."""
    jobs = list(product(KINDS, range(SEED, SEED + config.count), (True, False)))
    if config.kept is not None and config.kept.exists():
        with np.load(config.kept) as file:
            rows = [file[name] for name in file.files]
    else:
        with ProcessPoolExecutor(config.workers) as pool:
            rows = list(pool.map(judged_rows, jobs))
        if config.kept is not None:
            np.savez(config.kept, *rows)
    found = Judged.of(rows)
    kinds = np.array([list(KINDS).index(kind) for kind, *_ in jobs])
    named = {name: kinds[found.image] == k for k, name in enumerate(KINDS)}
    return f"{weights_text(found, FACTS)}\n\n{summary_of(found, named)}"


def judged_rows(job: tuple[str, int, bool]) -> Float[np.ndarray, "k 1+f"]:
    """Verdict and facts of the detections in a cloud, unsure ones too.

    Args:
        job: Kind, seed, and whether the viewpoint is known.
    """
    keep_compiled()
    kind, seed, is_told = job
    cloud = draw_cloud(kind, seed)
    given = points_given(cloud.points, cloud.origins if is_told else None)
    found, *_ = search_cloud(given, REQUEST)
    detections = [detection_of(one.fit, one.confidence) for one in found]
    verdicts = match(cloud.truth, detections, LEVELS["standard"]).verdict
    rows = [[verdict, *one.facts] for verdict, one in zip(verdicts, found, strict=True)]
    return np.array(rows, float).reshape(-1, 1 + len(FACTS))


if __name__ == "__main__":
    print(derive(tyro.cli(Config)))
