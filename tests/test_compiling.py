import subprocess
import sys
import typing

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.experimental.compilation_cache import compilation_cache
from jaxtyping import Array, Float

import impostor_jax as ij
from impostor_jax import compiling, program_store
from impostor_jax.caching import compiled_folder
from impostor_jax.compiling import compiled, computed_apart, computed_once
from impostor_jax.geometry.vec3 import Vec3
from tests.checks import AS_USERS_RUN
from tests.groups import FULL

CALLS = """
import os, jax, jax.numpy as jnp
from impostor_jax.compiling import kept
traced = []
def factor(matrix, turned):
    traced.append(turned)
    found = jnp.linalg.cholesky(matrix)
    return {"factor": found.T if turned else found}
found = kept(factor, static_argnames="turned")(4 * jnp.eye(2), turned=True)
assert found["factor"].tolist() == [[2, 0], [0, 2]], found
assert jax.config.jax_compilation_cache_dir is None
jax.config.update("jax_compilation_cache_dir", os.environ["XDG_CACHE_HOME"] + "/jax")
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
own = len(traced)
jax.jit(factor, static_argnames="turned")(4 * jnp.eye(2), turned=True)
print(own, len(traced) - own)
"""


@pytest.fixture(autouse=True)
def forget():
    """Options are asked for once in a process."""
    compiling._known_options.cache_clear()
    yield
    compiling._known_options.cache_clear()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Programs are kept in a folder of the test."""
    monkeypatch.setattr(program_store, "_folder", lambda: tmp_path / "kept")
    # JAX's own cache has what took long to compile, as all does on a slow machine; of
    # what comes from there no machine code is left to keep.
    is_used = jax.config.jax_enable_compilation_cache
    jax.config.update("jax_enable_compilation_cache", False)
    compilation_cache.reset_cache()
    yield tmp_path / "kept"
    jax.config.update("jax_enable_compilation_cache", is_used)
    compilation_cache.reset_cache()


@pytest.fixture
def traces():
    """Shapes with which functions of `kept_anew` were traced."""
    TRACES.clear()
    return TRACES


TRACES: list[tuple[int, ...]] = []


def times(array, factor):
    return array * factor


def kept_anew():
    """A function as a new process finds it: JAX remembers no trace of it."""

    def times(array, factor):
        TRACES.append(array.shape)
        return array * factor

    return compiling.kept.__wrapped__(times, static_argnames="factor")


def polynomial(x):
    """Cheap operations, which XLA would rather compute anew than keep."""
    for k in range(20):
        x = x * x + 0.01 * k
    return x


def depth_and_normal(values):
    """Two loops that read the same values."""
    return values, Vec3(values, 2 * values, 3 * values).stack()


def operations(function, *arguments):
    """Of a compiled call, as XLA counts them."""
    program = jax.jit(function).lower(*arguments).compile(AS_USERS_RUN)
    return program.cost_analysis()["flops"]


@pytest.mark.parametrize(
    "helped",
    [lambda f, x: computed_once(f), computed_apart],
    ids=["computed_once", "computed_apart"],
)
def test_xla_computes_anew_what_two_loops_read(helped):
    """Where this fails, XLA has learned it: the helper that it names can go."""
    x = jnp.linspace(0, 0.5, 96 * 64).reshape(64, 96)
    once, reading = operations(polynomial, x), operations(depth_and_normal, x)
    without = operations(lambda x: depth_and_normal(polynomial(x)), x)
    assert without == pytest.approx(2 * once + reading, rel=0.05)
    found = operations(lambda x: depth_and_normal(helped(lambda: polynomial(x), x)), x)
    assert found == pytest.approx(once + reading, rel=0.05)


def test_a_loop_of_one_turn_has_no_derivative_backwards_and_a_branch_has():
    """Where this fails, `computed_apart` may serve as `computed_once`."""
    assert jax.jit(jax.grad(lambda x: computed_once(lambda: x * x)))(3.0) == 6
    with pytest.raises(ValueError, match="Reverse-mode differentiation does not work"):
        jax.jit(jax.grad(lambda x: computed_apart(lambda: x * x, x)))(3.0)


def test_what_is_not_compiled_together_is_many_programs(caplog):
    """Where this fails, JAX joins single operations: `compiled` can go."""

    def programs(function, size) -> int:
        array = np.ones(size, np.float32)
        caplog.clear()
        with jax.log_compiles():
            function(array)
        return caplog.text.count("Finished XLA compilation")

    # Of sizes that no other test has compiled for.
    assert programs(compiled(lambda x: jnp.sin(jnp.abs(x) + x)), 1013) == 1
    assert programs(lambda x: jnp.sin(jnp.abs(x) + x), 1019) == 3


def test_the_older_generator_is_asked_for_where_there_is_one():
    (name,) = compiling.OLDER_GENERATOR
    older = compiling.OLDER_GENERATOR if name in AS_USERS_RUN else None
    assert compiling._known_options() == older
    assert compiling.quickly_compiled(times) is compiling.quickly_compiled(times)


def test_an_option_that_xla_does_not_know_is_left_out(folder, monkeypatch):
    monkeypatch.setattr(compiling, "OLDER_GENERATOR", {"xla_cpu_no_such": False})
    doubled = compiling.quickly_compiled(times, static_argnames="factor")
    assert doubled(jnp.ones(3), factor=2).tolist() == [2, 2, 2]
    assert compiling._known_options() is None


def test_a_new_process_loads_what_another_has_kept_in_the_users_cache(
    tmp_path, monkeypatch
):
    """Also what calls LAPACK, which JAX makes ready only where it compiles."""
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def traced() -> str:
        done = subprocess.run(
            [sys.executable, "-c", CALLS], capture_output=True, text=True, check=True
        )
        assert done.stderr == ""
        return done.stdout.strip()

    assert traced() == "1 1"
    assert len(list((compiled_folder() / "impostor_jax").iterdir())) == 1
    # Where the second is 0, JAX traces nothing that its cache holds: `kept` can go.
    assert traced() == "0 1"
    monkeypatch.setenv("JAX_ENABLE_COMPILATION_CACHE", "false")
    assert traced() == "1 1"
    assert len(list((compiled_folder() / "impostor_jax").iterdir())) == 1


@pytest.mark.parametrize(
    ("of_jax", "is_enabled", "expected"),
    [
        (None, True, "user/impostor_jax/compiled/impostor_jax"),
        ("gs://bucket", True, "user/impostor_jax/compiled/impostor_jax"),
        ("mine", True, "mine/impostor_jax"),
        ("", True, None),
        ("mine", False, None),
        (None, False, None),
    ],
)
def test_settings_of_jax_decide_where_programs_are_kept(
    of_jax, is_enabled, expected, tmp_path, monkeypatch
):
    class Config(typing.NamedTuple):
        jax_compilation_cache_dir: str | None
        jax_enable_compilation_cache: bool

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    of_jax = str(tmp_path / of_jax) if of_jax == "mine" else of_jax
    monkeypatch.setattr(program_store.jax, "config", Config(of_jax, is_enabled))
    found = program_store._folder()
    assert found == (None if expected is None else tmp_path / expected)


def test_a_program_serves_what_it_was_compiled_for_alone(folder, traces):
    for _ in range(2):
        again = kept_anew()
        assert again(np.ones(3, np.float32), factor=2).tolist() == [2, 2, 2]
        assert again(np.ones(2, np.float32), factor=2).tolist() == [2, 2]
        assert again(np.ones(2, np.float32), factor=3).tolist() == [3, 3]
        assert again(np.ones(2, np.int32), 3).tolist() == [3, 3]
        with jax.enable_x64(True):
            assert again(np.ones(2), 3).dtype == np.float64
    assert len(traces) == len(list(folder.iterdir())) == 5


def test_another_version_compiles_anew(folder, traces, monkeypatch):
    kept_anew()(jnp.ones(3), factor=2)
    monkeypatch.setattr(program_store, "_surroundings", lambda: "another processor")
    kept_anew()(jnp.ones(3), factor=2)
    assert len(traces) == len(list(folder.iterdir())) == 2


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"",
        lambda data: data[: len(data) // 2],
        lambda data: data[:-99] + bytes([data[-99] ^ 1]) + data[-98:],
        lambda data: b"no program",
    ],
)
def test_a_damaged_program_is_replaced(damage, folder, traces):
    kept_anew()(jnp.ones(3), factor=2)
    (entry,) = folder.iterdir()
    whole = entry.read_bytes()
    entry.write_bytes(damage(whole))
    assert kept_anew()(jnp.ones(3), factor=2).tolist() == [2, 2, 2]
    assert len(entry.read_bytes()) > len(whole) / 2
    kept_anew()(jnp.ones(3), factor=2)
    assert len(traces) == 2


def test_a_program_that_is_loaded_but_does_not_run_is_compiled(
    folder, traces, monkeypatch
):
    def fail(**_):
        raise jax.errors.JaxRuntimeError("NOT_FOUND")

    monkeypatch.setattr(program_store, "load", lambda *_: fail)
    assert kept_anew()(jnp.ones(3), factor=2).tolist() == [2, 2, 2]
    assert len(traces) == 1


@FULL
def test_a_program_that_is_forgotten_is_loaded_anew(folder, traces):
    doubled = kept_anew()
    doubled(jnp.ones(3), factor=2)
    compiling.forget()
    assert not doubled.programs
    assert doubled(jnp.ones(3), factor=2).tolist() == [2, 2, 2]
    assert len(traces) == 1


@pytest.mark.skipif(not compiling.memory_regions(), reason="the system does not tell")
def test_programs_make_room_before_memory_has_too_many_regions(monkeypatch):
    first, second = kept_anew(), kept_anew()
    first(jnp.ones(3), factor=2)
    second(jnp.ones(4), factor=2)
    assert first.programs
    monkeypatch.setattr(compiling, "MOST_REGIONS", 10)
    second(jnp.ones(5), factor=2)
    assert not first.programs
    assert len(second.programs) == 1


def test_a_folder_that_cannot_be_written_does_no_harm(folder, traces):
    folder.write_text("a file")
    assert kept_anew()(jnp.ones(3), factor=2).tolist() == [2, 2, 2]
    assert folder.read_text() == "a file"


def test_the_oldest_programs_make_room(folder, traces, monkeypatch):
    monkeypatch.setattr(program_store, "MOST_ENTRIES", 2)
    names = []
    for size in (1, 2, 3):
        kept_anew()(jnp.ones(size), factor=2)
        names.append({entry.name for entry in folder.iterdir()})
    assert len(names[1]) == len(names[2]) == 2
    assert not names[0] & names[2]


def test_a_traced_call_is_part_of_the_callers_program(folder, traces):
    doubled = kept_anew()
    slope = jax.grad(lambda x: doubled(x, factor=2).sum())(jnp.ones(3))
    assert slope.tolist() == [2, 2, 2]
    assert not folder.exists()


def test_a_call_that_jax_checks_is_left_to_it(folder):
    with jax.debug_nans(True), pytest.raises(FloatingPointError):
        kept_anew()(jnp.array(jnp.inf), factor=0)
    assert not folder.exists()


def test_a_call_on_a_processor_that_was_asked_for_is_kept(folder, traces):
    for _ in range(2):
        with jax.default_device(jax.devices("cpu")[0]):
            assert kept_anew()(jnp.ones(3), factor=2).tolist() == [2, 2, 2]
    assert len(traces) == 1
    assert len(list(folder.iterdir())) == 1


class Offset(eqx.Module):
    """A class of a user, whose methods decide what is compiled and may change."""

    by: Float[Array, ""]

    def __mul__(self, factor: float) -> Float[Array, ""]:
        return self.by + factor

    @property
    def shape(self) -> tuple[int, ...]:
        return self.by.shape


def test_what_a_users_class_takes_part_in_is_not_kept(folder, traces):
    assert kept_anew()(Offset(jnp.array(1.0)), factor=2) == 3
    assert not folder.exists()


def test_a_render_is_kept(folder, monkeypatch):
    # Also where the tests' own cache has it, from which it comes without machine code.
    monkeypatch.setattr(program_store, "MACHINE_CODE", (b"",))
    camera = ij.PinholeCamera(20, 20, 3.5, 2.5, 8, 6)
    maps = ij.render(ij.Sphere((0, 0, 2), 0.5), camera, ("depth",))
    assert maps.depth.min() == pytest.approx(1.5, abs=0.01)
    assert len(list(folder.iterdir())) == 1
