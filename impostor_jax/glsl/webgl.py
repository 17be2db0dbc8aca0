"""The same shaders in a browser: a self-contained page, and drawing through it."""

__all__ = ["WebglRenderer", "page"]

import base64
import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.glsl.chromium import headless_chromium
from impostor_jax.glsl.conventions import DrawnMaps, maps_from_targets
from impostor_jax.glsl.draw_list import CLEAR_COLOR, DrawList, draw_list_of
from impostor_jax.glsl.html import html_page, textures_message, traced_message
from impostor_jax.glsl.offscreen import DriverError
from impostor_jax.glsl.program import attributes, shader_sources
from impostor_jax.glsl.trace_list import Traceable, trace_list_of
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.rendering.lights import AbstractLight
from impostor_jax.rendering.material import Material


def page(
    primitives: AbstractPrimitive | Sequence[AbstractPrimitive],
    camera: PinholeCamera | OrthographicCamera,
    shaders: Path | None = None,
) -> str:
    """HTML page that draws primitives with WebGL2 and needs nothing else.

    Its function `drawScene` draws another scene of the same form as the page's own.

    Args:
        primitives: As `OffscreenRenderer.draw` takes them.
        camera: Without a lens.
        shaders: As of `OffscreenRenderer`.
    """
    return html_page(
        "glsl/page.html", _message(draw_list_of(primitives, camera), shaders)
    )


class WebglRenderer:
    """Draws primitives in headless Chromium; close it, or use it in a `with` block.

    Args:
        shaders: As of `OffscreenRenderer`.

    Attributes:
        name: What the browser's driver calls itself.

    Raises:
        DriverError: There is no Chromium, or playwright is missing.
    """

    def __init__(self, shaders: Path | None = None):
        self._shaders = shaders
        self._open = contextlib.ExitStack()
        browser = self._open.enter_context(headless_chromium())
        from playwright.sync_api import Error

        try:
            self._page = browser.new_page()
            one = Sphere((0, 0, 1), 0.1)
            camera = PinholeCamera(32.0, 32.0, 15.5, 15.5, 32, 32)
            self._page.set_content(page(one, camera, shaders))
            self.name = str(self._page.evaluate(_NAME))
        except Error as error:
            self._open.close()
            message = " ".join(str(error).split())
            raise DriverError(f"Chromium does not draw: {message}") from error

    def draw(
        self,
        primitives: AbstractPrimitive | Sequence[AbstractPrimitive],
        camera: PinholeCamera | OrthographicCamera,
    ) -> DrawnMaps:
        """Draw as `OffscreenRenderer.draw`, but for the depth buffer: none is read."""
        draws = draw_list_of(primitives, camera)
        message = _message(draws, self._shaders)
        found = self._page.evaluate("(scene) => drawScene(scene)", message)
        position, normal = (
            np.frombuffer(base64.b64decode(text), np.float32).reshape(
                camera.height, camera.width, 4
            )
            for text in found
        )
        return maps_from_targets(position, normal, None, draws.stretch)

    def trace(
        self,
        scene: Traceable,
        camera: PinholeCamera | OrthographicCamera,
        lights: Sequence[AbstractLight],
        materials: Material | Sequence[Material] | None = None,
        background: Any = (0.0, 0.0, 0.0),
        depth: int = 3,
    ) -> Float[np.ndarray, "h w 3"]:
        """Trace as `OffscreenRenderer.trace`."""
        told = trace_list_of(scene, camera, lights, materials, background, depth)
        message = traced_message(told, self._shaders)
        found = self._page.evaluate("(scene) => traceScene(scene)", message)
        drawn = np.frombuffer(base64.b64decode(found), np.float32)
        return drawn.reshape(camera.height, camera.width, 4)[::-1, :, :3]

    def close(self) -> None:
        """Close the browser."""
        self._open.close()

    def __enter__(self) -> "WebglRenderer":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


_NAME = """() => {
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  return gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
}"""


def _message(draws: DrawList, shaders: Path | None) -> dict[str, Any]:
    """What the page's `drawScene` takes."""
    calls = [
        {
            "name": call.impostor.name.partition("_")[0],
            "sources": shader_sources(
                call.impostor, "300 es", draws.orthographic, shaders
            ),
            "attributes": attributes(call.impostor),
            "instances": call.rows.ravel().tolist(),
            "count": len(call.rows),
            "textures": textures_message(call.textures),
        }
        for call in draws.calls
    ]
    return {"draws": calls, "uniforms": draws.uniforms, "nothing": CLEAR_COLOR}
