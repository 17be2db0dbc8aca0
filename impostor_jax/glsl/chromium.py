"""Chromium without a window, which draws on the processor."""

__all__ = ["headless_chromium"]

import contextlib
import shutil
from collections.abc import Iterator
from typing import Any

from impostor_jax.glsl.offscreen import DriverError

BROWSERS = ("chromium", "chromium-browser", "google-chrome")

FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-quic",
    "--no-first-run",
)
"""Draw on the processor, the same on every machine, and stay off the network."""


@contextlib.contextmanager
def headless_chromium() -> Iterator[Any]:
    """A `Browser` of playwright, which is closed at the end.

    Raises:
        DriverError: There is no Chromium, it does not start, or playwright is missing.
    """
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError:
        raise DriverError(
            "playwright is missing: pip install 'impostor-jax[gl]'"
        ) from None
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        raise DriverError(
            "no Chromium; on Debian: apt-get install --no-install-recommends chromium"
        )
    with sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(
                executable_path=program, args=list(FLAGS)
            )
        except Error as error:
            message = " ".join(str(error).split())
            raise DriverError(f"Chromium does not start: {message}") from error
        try:
            yield browser
        finally:
            browser.close()
