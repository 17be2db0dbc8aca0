"""Drawing without a display, on an OpenGL driver through EGL.

Mesa brings two drivers that need no graphics card: llvmpipe compiles the shaders for
the processor, softpipe interprets them and shares little of that code. Mesa reads its
choice once for each process, so a process draws with one of them.
"""

__all__ = ["DRIVERS", "DriverError", "OffscreenRenderer"]

import contextlib
import os
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from impostor_jax.arguments import one_of
from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.glsl.conventions import DrawnMaps, maps_from_targets
from impostor_jax.glsl.draw_list import CLEAR_COLOR, draw_list_of
from impostor_jax.glsl.impostor import Impostor
from impostor_jax.glsl.program import attributes, shader_sources
from impostor_jax.glsl.trace_list import Traceable, trace_list_of
from impostor_jax.glsl.trace_program import trace_sources
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.rendering.lights import AbstractLight
from impostor_jax.rendering.material import Material

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
        self._programs: dict[Hashable, Any] = {}
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
        self._check_open()
        draws, size = draw_list_of(primitives, camera), (camera.width, camera.height)
        with _holding(self._context) as (context, held):
            targets = [held(context.texture(size, 4, dtype="f4")) for _ in range(2)]
            depth = held(context.depth_texture(size))
            frame = held(context.framebuffer(targets, depth))
            frame.use()
            context.enable_only(context.DEPTH_TEST)
            frame.clear(*CLEAR_COLOR, depth=1.0)
            for call in draws.calls:
                program = self._program(call.impostor, draws.orthographic)
                _set(program, draws.uniforms)
                buffer = held(context.buffer(call.rows.tobytes()))
                layout, names = _layout(call.impostor, program)
                _bind(context, program, call.textures, held)
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

    def trace(
        self,
        scene: Traceable,
        camera: PinholeCamera | OrthographicCamera,
        lights: Sequence[AbstractLight],
        materials: Material | Sequence[Material] | None = None,
        background: Any = (0.0, 0.0, 0.0),
        depth: int = 3,
    ) -> Float[np.ndarray, "h w 3"]:
        """Trace as `impostor_jax.trace` does: the same picture off the edges.

        Args:
            scene: A scene, a shape, a batch (n,), or a sequence of shapes, in the world
                frame.
            camera: Without a lens.
            lights: In the world frame.
            materials: Of each shape or of all; white and dull if None.
            background: Color of rays that meet nothing.
            depth: Most times that a ray is mirrored or bent.

        Returns:
            Linear RGB from 0 up.

        Raises:
            ValueError: As of `trace`; or the camera has a lens, something is traced by
                JAX, or the renderer is closed.
        """
        self._check_open()
        told = trace_list_of(scene, camera, lights, materials, background, depth)
        size = (camera.width, camera.height)
        with _holding(self._context) as (context, held):
            target = held(context.texture(size, 4, dtype="f4"))
            held(context.framebuffer([target])).use()
            context.enable_only(context.NOTHING)
            program = self._compiled(
                told.key, lambda: trace_sources(told.key, "330", self._shaders)
            )
            _set(program, {**told.uniforms, **told.places})
            _bind(context, program, told.textures, held)
            array = held(context.vertex_array(program, []))
            array.render(context.TRIANGLE_STRIP, vertices=4)
            drawn = np.frombuffer(target.read(), np.float32)
        return drawn.reshape(*size[::-1], 4)[::-1, :, :3]

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

    def _check_open(self) -> None:
        if self._context is None:
            raise ValueError("the renderer is closed and draws no more")

    def _program(self, impostor: Impostor, orthographic: bool) -> Any:
        return self._compiled(
            (impostor.name, orthographic),
            lambda: shader_sources(impostor, "330", orthographic, self._shaders),
        )

    def _compiled(self, key: Hashable, sources: Callable[[], tuple[str, str]]) -> Any:
        """The program of a key, compiled once."""
        if key not in self._programs:
            vertex, fragment = sources()
            self._programs[key] = self._context.program(
                vertex_shader=vertex, fragment_shader=fragment
            )
        return self._programs[key]


@contextlib.contextmanager
def _holding(context: Any) -> Iterator[tuple[Any, Callable[[Any], Any]]]:
    """A context that draws, and what takes each thing that is released at the end."""
    with context, contextlib.ExitStack() as stack:

        def held(made: Any) -> Any:
            stack.callback(made.release)
            return made

        yield context, held


def _set(program: Any, uniforms: Mapping[str, tuple[float, ...]]) -> None:
    """Set those uniforms of a program that a driver has not dropped as not used."""
    for name, value in uniforms.items():
        if name in program:
            program[name].value = value


def _bind(
    context: Any,
    program: Any,
    textures: dict[str, Float[np.ndarray, "..."]],
    held: Callable[[Any], Any],
) -> None:
    """Bind textures to a program that reads them."""
    for unit, (name, texels) in enumerate(textures.items()):
        if name in program:
            held(_texture(context, texels)).use(unit)
            program[name].value = unit


def _texture(context: Any, texels: Float[np.ndarray, "..."]) -> Any:
    """Texture of floats that a shader reads one by one."""
    height, width, *each = texels.shape
    made = context.texture(
        (width, height), *(each or (1,)), texels.tobytes(), dtype="f4"
    )
    made.filter = (context.NEAREST, context.NEAREST)
    return made


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
