import subprocess
import sys
import typing

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

import impostor_jax as ij
from impostor_jax import compiling, program_store
from impostor_jax.caching import compiled_folder

CALLS = """
import jax, jax.numpy as jnp
from impostor_jax.compiling import kept
traced = []
def factor(matrix, turned):
    traced.append(turned)
    found = jnp.linalg.cholesky(matrix)
    return {"factor": found.T if turned else found}
found = kept(factor, static_argnames="turned")(4 * jnp.eye(2), turned=True)
assert found["factor"].tolist() == [[2, 0], [0, 2]], found
assert jax.config.jax_compilation_cache_dir is None
print(len(traced))
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
    return tmp_path / "kept"


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


def test_the_older_generator_is_asked_for_where_there_is_one():
    assert compiling._known_options() == compiling.OLDER_GENERATOR
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

    assert traced() == "1"
    assert len(list((compiled_folder() / "impostor_jax").iterdir())) == 1
    assert traced() == "0"
    monkeypatch.setenv("JAX_ENABLE_COMPILATION_CACHE", "false")
    assert traced() == "1"
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

    monkeypatch.setattr(program_store, "load", lambda place: fail)
    assert kept_anew()(jnp.ones(3), factor=2).tolist() == [2, 2, 2]
    assert len(traces) == 1


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


def test_a_render_is_kept(folder):
    camera = ij.PinholeCamera(20, 20, 3.5, 2.5, 8, 6)
    maps = ij.render(ij.Sphere((0, 0, 2), 0.5), camera, ("depth",))
    assert maps.depth.min() == pytest.approx(1.5, abs=0.01)
    assert len(list(folder.iterdir())) == 1
