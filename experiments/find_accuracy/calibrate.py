"""Derive the weights of the confidence from detections in images of other seeds.

The log-odds that a detection is right are a sum of what each fact tells (logistic
regression). The search chooses by the weights, too: after a change of what is found, or
of the facts, run this again until the weights stay.
"""

__all__ = [
    "Config",
    "Judged",
    "Weights",
    "fit_weights",
    "summary_of",
    "weights_text",
]

import dataclasses
import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import tyro
from jaxtyping import Bool, Float, Int

import impostor_jax as ij
from data_synth.presets import BANDED, PRESETS
from experiments.find_accuracy.programs import OUR_SOURCES
from experiments.find_accuracy.report import NAMES
from experiments.find_accuracy.runs import Runs, kept_folder
from experiments.markdown import number, table
from impostor_jax.caching import keep_compiled
from impostor_jax.find import search
from impostor_jax.find.confidence import FACTS
from impostor_jax.find.cylinders import MOST_PIXELS, read_by
from impostor_jax.find.fitting import Fitter
from impostor_jax.find.view import view_of
from impostor_jax.fit.options import Options
from impostor_jax.matching import (
    IGNORED,
    LEVELS,
    RIGHT,
    SURE,
    calibration,
    detection_of,
    match,
    truth_of,
)
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.dropout import Dropout

SEED = 7000
"""Of the first preset; each has its own. None that is reported is near."""

SENSORS: Mapping[str, AbstractDepthNoise | None] = {
    "its own": None,
    "banded": Dropout(BANDED),
}
"""That read the images of each preset: its own, and one whose neighbors share errors.
Where only hands, bottles and bags were read by such a one, that errors are shared spoke
against all: of right ones of such a sensor three in ten were less likely than not."""

REQUEST = search.Request(least_sure=0.002)
"""What `find_cylinders` looks for by default, and most of what it leaves out: weights
that have not seen what the last ones refused would let it in."""

FOLDS = 5
"""Parts of the images: each is judged by weights from the others."""

PRIOR = 0.3
"""Standard deviation of a weight before any detection, of a fact in deviations: drawn
sensors are told exactly, and real ones are not, so that no fact may count for all."""

STEPS = 20
"""Of Newton's method; it has settled after about eight."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Derive the weights of `impostor_jax/find/confidence.py`."""

    count: int = 100
    """Images of each preset."""
    workers: int = 2
    """Processes that make datasets and search them."""


class Weights(NamedTuple):
    """Log-odds: the bias, and a weight for each fact."""

    bias: float
    of_facts: Float[np.ndarray, " f"]

    def confidence(self, facts: Float[np.ndarray, "n f"]) -> Float[np.ndarray, " n"]:
        """Probability that each of some detections is right."""
        return _logistic(self.bias + facts @ self.of_facts)


class Judged(NamedTuple):
    """All detections that are right or wrong at the standard level.

    Attributes:
        facts: What speaks for and against each.
        right: Whether it is.
        image: Number of the image it is in.
    """

    facts: Float[np.ndarray, "n f"]
    right: Bool[np.ndarray, " n"]
    image: Int[np.ndarray, " n"]

    @staticmethod
    def of(rows: Sequence[Float[np.ndarray, "_ 1+f"]]) -> "Judged":
        """The detections of some images, but for those that are ignored."""
        image = np.repeat(np.arange(len(rows)), [len(own) for own in rows])
        verdict, facts = np.split(np.concatenate(rows), [1], axis=1)
        verdict = verdict[:, 0]
        rated = verdict != IGNORED
        return Judged(facts[rated], verdict[rated] == RIGHT, image[rated])


def derive(config: Config) -> str:
    """Search images of all presets, and tell the weights and how good they are."""
    keep_compiled()
    rows, names = [], []
    for name, (label, sensor) in itertools.product(NAMES, SENSORS.items()):
        preset = PRESETS[name]
        if sensor is not None:
            preset = dataclasses.replace(preset, sensor=sensor)
        seed = SEED + len(names)
        runs = Runs(preset, config.count, seed, kept_folder(), config.workers)
        rows += runs.of_each("facts", judged_rows, OUR_SOURCES)
        names.append(f"{name}, {label}")
    found = Judged.of(rows)
    part = found.image // config.count
    named = {name: part == k for k, name in enumerate(names)}
    return f"{weights_text(found, FACTS)}\n\n{summary_of(found, named)}"


def summary_of(found: Judged, named: Mapping[str, Bool[np.ndarray, " n"]]) -> str:
    """A table of how good weights are on images that they were not derived from.

    Args:
        found: The detections.
        named: Which of them are of each preset, by its name.
    """
    unseen = _cross_validated(found)
    rows = [_summary("all", found.right, unseen)]
    rows += [
        _summary(name, found.right[own], unseen[own]) for name, own in named.items()
    ]
    return table(
        ["detections", "all", "right", "false and sure", "right and not", "error"], rows
    )


def judged_rows(
    image: ij.LabeledImage, sensor: ij.AbstractDepthNoise
) -> Float[np.ndarray, "k 1+f"]:
    """Verdict and facts of the detections in an image, unsure ones too.

    It is searched twice: once with the sensor told, once with nothing told of it.
    """
    rows: list[list[float]] = []
    for told in (sensor, None):
        depth, noise, sigma = read_by(image.depth, image.camera, told)
        view = view_of(depth, image.camera, noise, MOST_PIXELS)
        fitter = Fitter.of(depth, image.camera, noise, sigma, Options())
        found = search.search(view, REQUEST, fitter).detections
        detections = [detection_of(one.fit, one.confidence) for one in found]
        verdicts = match(truth_of(image), detections, LEVELS["standard"]).verdict
        rows += [[v, *one.facts] for v, one in zip(verdicts, found, strict=True)]
    return np.array(rows, float).reshape(-1, 1 + len(FACTS))


def fit_weights(
    facts: Float[np.ndarray, "n f"], right: Bool[np.ndarray, " n"]
) -> Weights:
    """Logistic regression with a normal prior on the weights (ridge).

    The prior is on facts of mean 0 and deviation 1, and none is on the bias.
    """
    mean, spread = facts.mean(axis=0), facts.std(axis=0)
    spread = np.where(spread > 0, spread, 1.0)
    x = np.column_stack([np.ones(len(facts)), (facts - mean) / spread])
    penalty = np.full(x.shape[1], PRIOR**-2)
    penalty[0] = 0.0
    weights = np.zeros(x.shape[1])
    for _ in range(STEPS):
        chance = _logistic(x @ weights)
        gradient = x.T @ (chance - right) + penalty * weights
        curvature = (x.T * (chance * (1 - chance))) @ x + np.diag(penalty)
        weights -= np.linalg.solve(curvature, gradient)
    of_facts = weights[1:] / spread
    return Weights(float(weights[0] - mean @ of_facts), of_facts)


def _cross_validated(found: Judged) -> Float[np.ndarray, " n"]:
    """Confidence of each detection by weights from the images of the other folds."""
    confidence = np.zeros(len(found.right))
    for fold in range(FOLDS):
        own = found.image % FOLDS == fold
        weights = fit_weights(found.facts[~own], found.right[~own])
        confidence[own] = weights.confidence(found.facts[own])
    return confidence


def _logistic(odds: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return 1 / (1 + np.exp(-np.clip(odds, -50, 50)))


def _summary(
    name: str, right: Bool[np.ndarray, " n"], confidence: Float[np.ndarray, " n"]
) -> list[str]:
    """Counts of some detections, and how far their confidences are off."""
    sure = confidence >= SURE
    counts = (len(right), right.sum(), (sure & ~right).sum(), (~sure & right).sum())
    error = calibration(right, confidence).error if len(right) else None
    return [name, *map(str, counts), number(error, ".3f")]


def weights_text(found: Judged, names: Iterable[str]) -> str:
    """The weights as they stand in a `confidence.py`, in the order of their facts."""
    weights = fit_weights(found.facts, found.right)
    lines = [
        f'    "{name}": {weight:.2f},'
        for name, weight in zip(names, weights.of_facts, strict=True)
    ]
    facts = "\n".join(["FACTS: dict[str, float] = {", *lines, "}"])
    return f"{facts}\n\nBIAS = {weights.bias:.2f}"


if __name__ == "__main__":
    print(derive(tyro.cli(Config)))
