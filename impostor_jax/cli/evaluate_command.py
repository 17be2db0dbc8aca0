"""The command `impostor-jax evaluate`."""

__all__ = ["EvaluateCommand"]

import dataclasses
import itertools
import sys
from functools import partial
from pathlib import Path
from typing import Any

import tyro

from impostor_jax.cli.dials import Dials, EffortName, chosen_effort
from impostor_jax.cli.ending import stream_beside
from impostor_jax.io.atomic import check_output_file, write_json
from impostor_jax.plain_arguments import whole_number


@dataclasses.dataclass(frozen=True)
class EvaluateCommand:
    """Fit every visible cylinder of a synthetic dataset and compare with the truth.

    Prints errors, errors over their standard deviations and the coverage of the
    intervals, by the part of a cylinder that is seen. With --find the cylinders are
    found without masks, and recall, false ones and average precision come first.
    """

    dataset: tyro.conf.Positional[Path]
    """Folder of a dataset that impostor-synth made."""
    find: bool = False
    """Whether cylinders are found without masks, instead of fitted with the true ones;
    those count that have 300 readings and of which 0.3 are seen."""
    limit: int | None = None
    """Most images; all if not given."""
    erode_px: int = 0
    """How many pixels deep to leave out the edges of masks, where a sensor may mix
    readings with those behind."""
    json: Path | None = None
    """File for the outcome of every cylinder; "-" is the standard output."""
    effort: EffortName = "balanced"
    """How much work each fit takes; each dial may be set apart from it."""
    dials: Dials = dataclasses.field(default_factory=Dials)

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from tqdm import tqdm

        from impostor_jax.io.dataset_manifest import read_manifest, shards_there

        effort = chosen_effort(self.effort, self.dials)
        if self.limit is not None:
            whole_number("limit", self.limit, 1)
        whole_number("erode_px", self.erode_px, 0)
        if self.find and self.erode_px:
            raise ValueError("--erode-px must not be given with --find: it has no mask")
        if self.json is not None:
            check_output_file(self.json, "json")
        manifest = read_manifest(self.dataset)
        shards_there(self.dataset, manifest, allow_partial=False)
        # These start JAX.
        from impostor_jax.evaluate import evaluate, evaluate_found, table
        from impostor_jax.io.dataset import read_dataset, sensor_of
        from impostor_jax.matching import score_of, score_record, score_table

        sensor = sensor_of(manifest)
        images = itertools.islice(read_dataset(self.dataset), self.limit)
        shown = partial(
            tqdm,
            total=min(manifest["count"], self.limit or manifest["count"]),
            unit="image",
            disable=None,
            file=sys.stderr,
        )
        score = None
        if self.find:
            searched = list(shown(evaluate_found(images, sensor, effort)))
            outcomes = [outcome for image in searched for outcome in image.outcomes]
            score = score_of([image.comparison for image in searched])
        else:
            fitted = shown(evaluate(images, sensor, self.erode_px, effort))
            outcomes = [outcome for some in fitted for outcome in some]
        if self.json is not None:
            told: Any = [dataclasses.asdict(outcome) for outcome in outcomes]
            if score is not None:
                told = {"score": score_record(score), "outcomes": told}
            write_json(self.json, told)
        parts = [] if score is None else [score_table(score)]
        if outcomes:
            parts.append(table(outcomes))
        elif score is None:
            parts.append(f"{self.dataset}: no cylinder to fit")
        print("\n".join(parts), file=stream_beside(self.json))
        return 0
