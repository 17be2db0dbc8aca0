"""Draw the pictures of the README: shapes, derivatives and fits."""

__all__ = ["Config", "run"]

import dataclasses
import sys
import time
from pathlib import Path

import tyro

from experiments.gallery import fits, gradients, shapes
from experiments.gallery.panel import save
from experiments.gallery.report import tables
from experiments.recording import Metric, result_folder, save_run

HERE = Path(__file__).parent


@dataclasses.dataclass(frozen=True)
class Config:
    """Pictures of shapes, derivatives and fits."""

    width: int = 480
    """Of an image of the shapes, in pixels."""
    gradient_width: int = 240
    """Of an image of derivatives of depth."""
    coverage_width: int = 32
    """Of an image of coverage."""
    seed: int = 0
    """Of the noise that is fitted."""
    quick: bool = False
    """Only the derivatives, of small images, into a temporary folder."""
    output: Path | None = None
    """Folder for the results; that of the experiment if None."""


def run(config: Config) -> int:
    """Draw, measure and write; returns the exit code."""
    started = time.perf_counter()
    folder = result_folder(config.output, HERE, quick=config.quick)
    if config.quick:
        config = dataclasses.replace(config, gradient_width=32, coverage_width=16)
    sizes = config.gradient_width, config.coverage_width
    pictures = {
        "shapes": lambda: shapes.draw(config.width),
        "gradients": lambda: gradients.draw(*sizes),
        "fits": lambda: fits.draw(config.seed),
    }
    if config.quick:
        pictures = {"gradients": pictures["gradients"]}
    metrics = []
    for name, draw in pictures.items():
        figure, measured = draw()
        # Noise has few colors, in an order that hardly compresses.
        colors = 256 if name == "fits" else None
        size = save(figure, folder / "figures" / f"{name}.png", colors)
        metrics += [*measured, Metric(f"{name}.size", size, None, "B", "lower", 1)]
    save_run(
        folder,
        metrics,
        config,
        seed=config.seed,
        dtype="float32",
        seconds=time.perf_counter() - started,
        quick=config.quick,
    )
    print(tables(folder))
    return 0


if __name__ == "__main__":
    sys.exit(run(tyro.cli(Config)))
