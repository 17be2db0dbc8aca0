"""Drawing without a display, on an OpenGL driver through EGL.

Mesa brings two drivers that need no graphics card: llvmpipe compiles the shaders for
the processor, softpipe interprets them and shares little of that code. Mesa reads its
choice once for each process, so a process draws with one of them.
"""

__all__ = ["DRIVERS", "DriverError", "OffscreenRenderer"]

import contextlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from impostor_jax.arguments import one_of
from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.glsl.conventions import DrawnMaps, maps_from_targets
from impostor_jax.glsl.draw_list import CLEAR_COLOR, draw_list_of
from impostor_jax.glsl.impostors import Impostor
from impostor_jax.glsl.program import attributes, shader_sources
from impostor_jax.primitives.base import AbstractPrimitive

DRIVERS: dict[str, dict[str, str]] = {
    "llvmpipe": {"LIBGL_ALWAYS_SOFTWARE": "1", "GALLIUM_DRIVER": "llvmpipe"},
    "softpipe": {"LIBGL_ALWAYS_SOFTWARE": "1", "GALLIUM_DRIVER": "softpipe"},
    "gpu": {},
}
"""Environment that makes Mesa choose a driver; "gpu" takes what the system offers."""

MAX_DEVICES = 8
"""Devices of EGL that are asked for a driver."""

_VARIABLES = ("LIBGL_ALWAYS_SOFTWARE", "GALLIUM_DRIVER")

_chosen: list[str] = []


class DriverError(OSError):
    """No driver or browser to draw with; the message names what to install."""


class OffscreenRenderer:
    """Draws primitives into float32 targets; close it, or use it in a `with` block.

    Args:
        driver: "llvmpipe", "softpipe", or "gpu" for the system's own.
        shaders: Folder whose shaders take the place of those of the same names.

    Attributes:
        name: What the driver calls itself.

    Raises:
        ValueError: The driver is unknown, or this process draws with another one.
        DriverError: There is no such driver, or moderngl is missing.
    """

    def __init__(self, driver: str = "llvmpipe", shaders: Path | None = None):
        one_of("driver", driver, DRIVERS)
        if _chosen and _chosen[0] != driver:
            raise ValueError(
                f"driver must be {_chosen[0]!r}, which this process draws with "
                f"already, got {driver!r}; use another process"
            )
        self._shaders = shaders
        self._programs: dict[tuple[str, bool], Any] = {}
        self._context: Any = _context(driver)
        self.name = str(self._context.info["GL_RENDERER"])
        _chosen[:] = [driver]

    def draw(
        self,
        primitives: AbstractPrimitive | Sequence[AbstractPrimitive],
        camera: PinholeCamera | OrthographicCamera,
    ) -> DrawnMaps:
        """Draw primitives in one call for each type; the closest one is seen.

        Args:
            primitives: In the world frame: one, a batch (n,), or a sequence of these,
                whose types may differ. The index counts through the sequence.
            camera: Without a lens.

        Returns:
            The maps as NumPy arrays. The depth buffer has 24 bits: of surfaces nearer
            to each other than a 17-millionth of the depth of all that is drawn, the
            first of a type is seen, and of the type that is given first.

        Raises:
            ValueError: The camera has a lens, an argument is of a wrong type or traced,
                or the renderer is closed.
        """
        if self._context is None:
            raise ValueError("the renderer is closed and draws no more")
        draws, size = draw_list_of(primitives, camera), (camera.width, camera.height)
        with self._context as context, contextlib.ExitStack() as stack:

            def held(made: Any) -> Any:
                stack.callback(made.release)
                return made

            targets = [held(context.texture(size, 4, dtype="f4")) for _ in range(2)]
            depth = held(context.depth_texture(size))
            frame = held(context.framebuffer(targets, depth))
            frame.use()
            context.enable_only(context.DEPTH_TEST)
            frame.clear(*CLEAR_COLOR, depth=1.0)
            for call in draws.calls:
                program = self._program(call.impostor, draws.orthographic)
                for name, value in draws.uniforms.items():
                    # A driver drops what a variant of the shader does not use.
                    if name in program:
                        program[name].value = value
                buffer = held(context.buffer(call.rows.tobytes()))
                layout, names = _layout(call.impostor, program)
                if call.samples.size:
                    height, width = call.samples.shape
                    samples = held(
                        context.texture(
                            (width, height), 1, call.samples.tobytes(), dtype="f4"
                        )
                    )
                    samples.filter = (context.NEAREST, context.NEAREST)
                    samples.use(0)
                array = held(context.vertex_array(program, [(buffer, layout, *names)]))
                array.render(
                    context.TRIANGLE_STRIP, vertices=4, instances=len(call.rows)
                )
            position, normal = (
                np.frombuffer(target.read(), np.float32).reshape(*size[::-1], 4)
                for target in targets
            )
            window = np.frombuffer(depth.read(), np.float32).reshape(size[::-1])
        return maps_from_targets(position, normal, window, draws.stretch)

    def close(self) -> None:
        """Release the programs and the context."""
        if self._context is None:
            return
        with self._context:
            for program in self._programs.values():
                program.release()
        self._programs.clear()
        self._context.release()
        self._context = None

    def __enter__(self) -> "OffscreenRenderer":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _program(self, impostor: Impostor, orthographic: bool) -> Any:
        key = (impostor.name, orthographic)
        if key not in self._programs:
            vertex, fragment = shader_sources(
                impostor, "330", orthographic, self._shaders
            )
            self._programs[key] = self._context.program(
                vertex_shader=vertex, fragment_shader=fragment
            )
        return self._programs[key]


def _layout(impostor: Impostor, program: Any) -> tuple[str, list[str]]:
    """Layout of an instance's row in moderngl's words, and the names in it.

    What the driver has dropped from the program is skipped.
    """
    parts, names = [], []
    for name, count in attributes(impostor):
        parts.append(f"{count}f" if name in program else f"{4 * count}x")
        names += [name] if name in program else []
    return " ".join(parts) + "/i", names


def _context(driver: str) -> Any:
    """Context of a driver; the environment stays as it was where there is none."""
    try:
        import moderngl
    except ImportError:
        raise DriverError(
            "moderngl is missing: pip install 'impostor-jax[gl]'"
        ) from None
    before = {name: os.environ[name] for name in _VARIABLES if name in os.environ}
    os.environ.update(DRIVERS[driver])
    found = []
    # A machine with a graphics card has several devices, and Mesa's may not be first.
    for device in range(MAX_DEVICES):
        try:
            context = moderngl.create_context(
                standalone=True,
                require=330,
                # The signature names the type of further settings, not of these.
                backend="egl",  # pyright: ignore[reportArgumentType]
                device_index=device,  # pyright: ignore[reportArgumentType]
            )
        # moderngl raises plain exceptions of its own.
        except Exception as error:
            found.append(" ".join(str(error).split()))
            if device:
                break
            continue
        name = str(context.info["GL_RENDERER"])
        is_software = any(software in name for software in ("llvmpipe", "softpipe"))
        if driver in name or (driver == "gpu" and not is_software):
            return context
        found.append(name)
        context.release()
    for name in _VARIABLES:
        os.environ.pop(name, None)
    os.environ.update(before)
    need = (
        "a graphics card and its EGL driver are needed"
        if driver == "gpu"
        else "on Debian: apt-get install --no-install-recommends libegl1 libgl1 "
        "libgl1-mesa-dri"
    )
    raise DriverError(f"no OpenGL driver {driver} ({'; '.join(found)}); {need}")
