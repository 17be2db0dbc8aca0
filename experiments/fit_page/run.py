"""Make the pages of two fits, open them in a browser, and take pictures of them."""

__all__ = ["Config", "measure"]

import dataclasses
import io
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import impostor_jax as ij
from experiments.fit_page.report import tables
from experiments.fit_page.scenes import can_page, table_page
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.timing import sample
from impostor_jax.glsl.chromium import headless_chromium
from impostor_jax.glsl.offscreen import DriverError
from impostor_jax.io.atomic import write_atomically

WINDOWS = {
    "desktop": ((900, 560), "light"),
    "dark": ((900, 560), "dark"),
    "phone": ((360, 740), "light"),
}
"""Sizes, and color schemes, of the windows that pages are opened in."""

PICTURES = (("can", "desktop"), ("table", "dark"), ("table", "phone"))
"""Pages and windows of which a picture is kept."""

FRAME = """() => {
  const start = performance.now(), pixel = new Uint8Array(4), { gl } = stage;
  view.turnBy(0.01, 0);
  stage.draw(view, shown);
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
  return performance.now() - start;
}"""
"""Draws once more, a little turned; the milliseconds that it takes."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Sizes and times of pages, and pictures of them."""

    run: RunConfig = RunConfig()
    width: int = 640
    """Of the depth images, in pixels."""
    frames: int = 30
    """That are timed."""
    seed: int = 0
    """Of the noise."""
    table: bool = True
    """Whether to search a table for cans, beside the fit of one."""


def measure(config: Config) -> Iterator[Metric]:
    """Each page in each window."""
    pages = {"can": can_page(config.width, config.seed)}
    if config.table:
        pages["table"] = table_page(config.width, config.seed)
    try:
        with headless_chromium() as browser:
            for name, page in pages.items():
                yield Metric(
                    f"{name}.size", len(page.html.encode()), None, "B", "lower", 1
                )
                for window in WINDOWS:
                    yield from _opened(name, page, browser, window, config)
    except DriverError as problem:
        # Ends the command with this line.
        raise OSError(str(problem)) from problem


def _opened(
    name: str, page: ij.FitPage, browser: Any, window: str, config: Config
) -> Iterator[Metric]:
    """Open a page in a window of playwright's browser, time it, take its picture."""
    (width, height), scheme = WINDOWS[window]
    opened = browser.new_page(
        viewport={"width": width, "height": height},
        color_scheme="dark" if scheme == "dark" else "light",
    )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "page.html"
        page.save(file)
        start = time.perf_counter()
        opened.goto(file.as_uri())
        opened.wait_for_selector("canvas[data-drawn=whole]")
        seconds = time.perf_counter() - start
    yield Metric(f"{name}.{window}.open", seconds, None, "s", "lower", 1)
    assert config.run.output is not None
    if name == "table":
        opened.evaluate("choose(0)")
        opened.wait_for_selector("canvas[data-drawn=whole]")
    if (name, window) in PICTURES:
        size = _save(opened, config.run.output / "figures" / f"{name}_{window}.png")
        yield Metric(f"{name}.{window}.picture", size, None, "B", "lower", 1)
    frames = np.array([opened.evaluate(FRAME) for _ in range(config.frames)])
    yield sample(f"{name}.{window}.frame", frames, "ms")
    opened.close()


def _save(opened: Any, path: Path) -> int:
    """Write what playwright's page shows as PNG; returns its size in bytes."""
    with Image.open(io.BytesIO(opened.screenshot())) as full:
        picture = full.convert("RGB")
    write_atomically(path, lambda partial: picture.save(partial, optimize=True))
    return path.stat().st_size


if __name__ == "__main__":
    main(Config, measure, tables, Config(width=160, frames=2, table=False))
