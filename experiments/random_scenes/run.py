"""Fit random scenes with exact masks, and count what is wrong and does not say so."""

__all__ = ["Config", "measure"]

import dataclasses
from collections import Counter
from collections.abc import Iterator, Sequence

from experiments.random_scenes.judged import GROSS, Judged, judge
from experiments.random_scenes.report import tables
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.scenes import draw_scene
from experiments.timing import sample
from impostor_jax.fit.status import FitStatus

KINDS = {"clutter": False, "alone": True}
"""Kinds of scenes, and whether nothing else than the cylinder has a reading."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how often fits of random scenes are wrong and do not say so."""

    run: RunConfig = RunConfig()
    scenes: int = 1000
    """Of each kind."""
    seed: int = 0
    """Of the first scene; the others follow it."""


def measure(config: Config) -> Iterator[Metric]:
    """Measure both kinds of scenes."""
    judge(draw_scene(config.seed), config.seed)
    seeds = range(config.seed, config.seed + config.scenes)
    for name, is_alone in KINDS.items():
        yield from _counted(name, [judge(draw_scene(k, is_alone), k) for k in seeds])


def _counted(name: str, fits: Sequence[Judged]) -> Iterator[Metric]:
    """Shares of all fits, their statuses, and each that is wrong."""
    n = len(fits)
    status = Counter(fit.status for fit in fits)
    wrong = [fit for fit in fits if fit.is_wrong]
    ambiguous = [fit for fit in fits if fit.status == FitStatus.AMBIGUOUS]
    right = status[FitStatus.CONVERGED] - len(wrong)
    yield Metric.share(f"{name}.right", right / n, n)
    for one in FitStatus:
        if status[one]:
            yield Metric(f"{name}.status.{one}", status[one], None, "fits", "lower", n)
    yield Metric(f"{name}.wrong", len(wrong), None, "fits", "lower", n)
    gross = sum(not fit.off <= GROSS for fit in wrong)
    yield Metric(f"{name}.gross", gross, None, "fits", "lower", n)
    told = sum(fit.is_told for fit in ambiguous)
    yield Metric(f"{name}.told", told, None, "fits", "higher", len(ambiguous))
    for fit in wrong:
        key = f"{name}.wrong.{fit.seed}"
        yield Metric(key, fit.off, None, "deviations", "lower", 1)
        yield Metric(f"{key}.axis", fit.axis_deg, None, "degrees", "lower", 1)
    yield sample(f"{name}.time", [fit.milliseconds for fit in fits], "ms")


if __name__ == "__main__":
    main(Config, measure, tables, Config(scenes=2))
