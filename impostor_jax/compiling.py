"""Where the system's compiler needs help, and how.

XLA computes anew, or writes to a buffer, what several loops read (`computed_once`,
`computed_apart`); it takes long over many loops (`quickly_compiled`); what it has made
is traced again by every process (`kept`); and it sees no more at a time than what is
compiled together (`compiled`). Each says what it was measured to save, and
`tests/test_compiling.py` tells by counts, not by time, when it can go.
"""

__all__ = [
    "compiled",
    "computed_apart",
    "computed_once",
    "forget",
    "kept",
    "memory_regions",
    "quickly_compiled",
]

import contextlib
import functools
import inspect
import threading
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax import program_store
from impostor_jax.device import where

Values = TypeVar("Values")
Method = TypeVar("Method", bound=Callable[..., Any])

OLDER_GENERATOR: dict[str, bool | int] = {"xla_cpu_use_fusion_emitters": False}
"""XLA's older code generator for processors. The hundreds of loops of a fit take it
half the time of the newer one, and run as fast."""

SETTINGS = ("jax_enable_x64", "jax_default_matmul_precision")
"""Of JAX, that decide what is compiled."""

LEFT_TO_JAX = (
    "jax_debug_nans",
    "jax_debug_infs",
    "jax_disable_jit",
)
"""Settings of JAX, each unset by default, with which `jax.jit` itself is called."""

MOST_REGIONS = 50_000
"""Of memory, that this process may have and still get a program. A fit's take 1100,
with JAX 0.12 2400; Linux allows 65,530, and XLA ends the process where it gets none."""


def computed_once(function: Callable[[], Values]) -> Values:
    """Value of a function, kept in memory for all that reads it.

    XLA would compute it anew in each of the loops that need it, but not what a branch
    yields: a fit's residual terms then take 1.6 times the operations. That the branch
    is always taken is hidden from XLA, and is the same for all problems of a batch,
    over which it stays a branch.
    """
    always = jax.lax.optimization_barrier(jnp.array(True))
    return jax.lax.cond(always, *_traced_once(function))


def computed_apart(
    function: Callable[[], Values], witness: Float[Array, "..."]
) -> Values:
    """Value of a function, in a program of its own; without a derivative.

    XLA otherwise writes every shared square root and quotient to a buffer of its own,
    or computes it anew for all that reads it, and it fuses across any boundary but a
    loop: a loop of one turn, counted at run time, takes a cylinder's 640x480 frame from
    2.8 ms to 1.1 ms, and depth and normal from 2.4 times the operations. A branch would
    save 0.05 ms more, but rounds a sphere seen by an orthographic camera to 5 ulps
    where OpenGL's differs by less than 4.

    Args:
        function: What is computed.
        witness: Any number that only the run knows.
    """
    function, zeros = _traced_once(function)
    # Always 1, but only the run knows: a bit pattern cut off to [1, 1].
    number = jnp.ravel(witness)[0].astype(jnp.float32)
    bits = jax.lax.bitcast_convert_type(number, jnp.int32)
    turns = jnp.clip(bits, 1, 1)
    return jax.lax.fori_loop(0, turns, lambda _, __: function(), zeros())


def _traced_once(
    function: Callable[[], Values],
) -> tuple[Callable[[], Values], Callable[[], Values]]:
    """A function that is traced once, for its shapes too, and what returns zeros."""
    function = jax.jit(function)
    shapes = jax.eval_shape(function)

    def zeros() -> Values:
        return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)

    return function, zeros


def compiled(method: Method) -> Method:
    """`jax.jit`, typed as what it wraps, so that the method may override another.

    For `sample` of noise models: called as it is on 640x480 pixels, step by step, three
    nested parts take 149 ms and 4.7 s the first time, and 85 ms and 2.8 s compiled.
    """
    return cast(Method, jax.jit(method))


@functools.cache
def quickly_compiled(
    function: Callable[..., Any], optimized: bool = True, **options: Any
) -> "_Kept":
    """`kept` of a function, compiled in half the time where XLA can.

    Args:
        function: As of `kept`. Where it is part of a caller's program, that is compiled
            as the caller asks.
        optimized: Whether XLA optimizes. Where not, conditions of parity compile in
            half of that time, and run up to three times as long.
        options: Of `jax.jit`.
    """
    asked = _known_options if optimized else _without_optimization
    return _Kept(function, options, asked)


@functools.cache
def kept(function: Callable[..., Any], **options: Any) -> "_Kept":
    """`jax.jit` of a function of this package, kept on disk for the next process.

    Args:
        function: Its source, and what it calls, is in this package.
        options: Of `jax.jit`.
    """
    return _Kept(function, options, lambda: None)


class _Kept:
    """A function with its compiled programs.

    Attributes:
        programs: Compiled or loaded in this process, by what they were compiled for.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        options: dict[str, Any],
        compiler_options: Callable[[], dict[str, bool | int] | None],
    ):
        self._function = function
        self._options = options
        self._compiler_options = compiler_options
        self._name = f"{function.__module__}.{function.__qualname__}"
        self._signature = inspect.signature(function)
        names = options.get("static_argnames", ())
        self._static_names = (names,) if isinstance(names, str) else tuple(names)
        self.programs: dict[Any, Callable[..., Any]] = {}
        self._lock = threading.RLock()
        _made.add(self)

    @functools.cached_property
    def _jitted(self) -> Any:
        return jax.jit(self._function, **self._options)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        given, static, key = self._asked(args, kwargs)
        if key is None:
            return self._jitted(**given, **static)
        return self._program(given, static, key)(**given)

    def ready(self, *args: Any, **kwargs: Any) -> Callable[[], Any] | None:
        """The call with such arguments; None where its program is not there yet."""
        given, static, key = self._asked(args, kwargs)
        if key is None:
            return functools.partial(self._jitted, **given, **static)
        program = self.programs.get(key)
        return program and functools.partial(program, **given)

    def prepare(self, *args: Any, **kwargs: Any) -> None:
        """Load or compile the program for such arguments."""
        given, static, key = self._asked(args, kwargs)
        if key is not None:
            self._program(given, static, key)

    def _asked(
        self, args: tuple[Any, ...], kwargs: dict[str, Any]
    ) -> tuple[dict[str, Any], dict[str, Any], tuple[Any, ...] | None]:
        """Arguments by name, the static ones, and what a program is kept by, if any."""
        given = self._signature.bind(*args, **kwargs).arguments
        static = {name: given.pop(name) for name in self._static_names if name in given}
        leaves, tree = jax.tree.flatten(given)
        types = _types_to_keep(leaves)
        if types is None:
            return given, static, None
        settings = *(getattr(jax.config, name) for name in SETTINGS), where()
        return given, static, (tree, tuple(static.items()), types, settings)

    def _program(
        self, given: dict[str, Any], static: dict[str, Any], key: tuple[Any, ...]
    ) -> Callable[..., Any]:
        program = self.programs.get(key)
        if program is None:
            # Of threads that need the same, one compiles.
            with self._lock:
                program = self.programs.get(key)
                if program is None:
                    program = self._load_or_compile(key, given, static)
                    self.programs[key] = program
        return program

    def _load_or_compile(
        self, key: tuple[Any, ...], given: dict[str, Any], static: dict[str, Any]
    ) -> Callable[..., Any]:
        if memory_regions() > MOST_REGIONS:
            forget()
        place = None
        if _is_of_this_package(key[0]):
            place = program_store.place_of((self._name, *key))
        if place is not None:
            program = program_store.load(place, where())
            # Whether it runs here, its first call tells.
            with contextlib.suppress(Exception):
                if program is not None:
                    jax.block_until_ready(program(**given))
                    return program
        lowered = self._jitted.lower(**given, **static)
        program = lowered.compile(self._compiler_options())
        if place is not None:
            program_store.save(program, place)
        return program


_made: weakref.WeakSet[_Kept] = weakref.WeakSet()


def forget() -> None:
    """Let go of all programs of this process, which are compiled or loaded anew."""
    # Another thread may make one more.
    for function in list(_made):
        function.programs.clear()
    # JAX remembers what it has compiled for them.
    jax.clear_caches()


def memory_regions() -> int:
    """How many this process has; 0 where the system does not tell."""
    with contextlib.suppress(OSError):
        return Path("/proc/self/maps").read_bytes().count(b"\n")
    return 0


def _types_to_keep(leaves: list[Any]) -> tuple[Any, ...] | None:
    """Types of numbers for which a program may be kept; None where none may.

    Numbers, where they lie and JAX's settings are those of a kept program on processors
    alone. Anything else `jax.jit` does itself.
    """
    if any(getattr(jax.config, name) for name in LEFT_TO_JAX):
        return None
    device = where()
    if device.platform != "cpu":
        return None
    here, types = {device}, []
    for leaf in leaves:
        if isinstance(leaf, jax.core.Tracer):
            return None
        if isinstance(leaf, jax.Array):
            # JAX moves what is not tied to another device.
            if leaf.committed and leaf.devices() != here:
                return None
            # What `jax.typeof` returns, in a tenth of its time.
            types.append(leaf.aval)
        elif isinstance(leaf, np.ndarray):
            types.append(_type_of_array(leaf.dtype, leaf.shape))
        else:
            types.append(jax.typeof(leaf))
    return tuple(types)


@functools.lru_cache(maxsize=256)
def _type_of_array(dtype: np.dtype, shape: tuple[int, ...]) -> Any:
    """Type of NumPy arrays, looked up in a tenth of the time of `jax.typeof`."""
    return jax.typeof(np.empty(shape, dtype))


def _is_of_this_package(tree: Any) -> bool:
    """Whether no user's class, which may change, decides what is compiled."""
    data = tree.node_data()
    package = __name__.split(".")[0]
    own = data is None or data[0].__module__.split(".")[0] in (package, "builtins")
    return own and all(map(_is_of_this_package, tree.children()))


@functools.cache
def _known_options() -> dict[str, bool | int] | None:
    """None where XLA no longer has the older one."""
    try:
        jax.jit(lambda: 0, compiler_options=OLDER_GENERATOR).lower().compile()
    except jax.errors.JaxRuntimeError:
        return None
    return OLDER_GENERATOR


def _without_optimization() -> dict[str, bool | int]:
    return {**(_known_options() or {}), "xla_backend_optimization_level": 0}
