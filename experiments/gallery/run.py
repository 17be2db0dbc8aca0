"""Draw the pictures of the README: shapes, derivatives and fits."""

__all__ = ["Config", "measure"]

import dataclasses
from collections.abc import Iterator

from experiments.gallery import fits, gradients, shapes
from experiments.gallery.panel import save
from experiments.gallery.report import tables
from experiments.recording import Metric
from experiments.running import RunConfig, main


@dataclasses.dataclass(frozen=True)
class Config:
    """Pictures of shapes, derivatives and fits."""

    run: RunConfig = RunConfig()
    width: int = 480
    """Of an image of the shapes, in pixels."""
    gradient_width: int = 240
    """Of an image of derivatives of depth."""
    coverage_width: int = 32
    """Of an image of coverage."""
    seed: int = 0
    """Of the noise that is fitted."""


def measure(config: Config) -> Iterator[Metric]:
    """Draw each picture, with what is measured for it, and its size."""
    sizes = config.gradient_width, config.coverage_width
    pictures = {
        "shapes": lambda: shapes.draw(config.width),
        "gradients": lambda: gradients.draw(*sizes),
        "fits": lambda: fits.draw(config.seed),
    }
    assert config.run.output is not None
    for name in ("gradients",) if config.run.quick else pictures:
        figure, measured = pictures[name]()
        # Noise has few colors, in an order that hardly compresses.
        colors = 256 if name == "fits" else None
        size = save(figure, config.run.output / "figures" / f"{name}.png", colors)
        yield from measured
        yield Metric(f"{name}.size", size, None, "B", "lower", 1)


if __name__ == "__main__":
    main(Config, measure, tables, Config(gradient_width=32, coverage_width=16))
