import dataclasses
import subprocess
import sys
import typing

import pytest

from impostor_jax.cli.dials import Dials, EffortName, chosen_effort
from impostor_jax.effort import EFFORTS, Effort, effort_of


@pytest.mark.parametrize(
    ("dials", "message"),
    [
        ({"stride": 0}, "stride must be a whole number of at least 1, got 0"),
        ({"readings": 9}, "readings must be at least 50, got 9"),
        ({"readings": 0}, "readings must be a whole number of at least 1, got 0"),
        ({"starts": True}, "starts must be a whole number of at least 1, got True"),
        ({"tolerance": 0.0}, "positive number of standard deviations, got 0"),
        ({"tolerance": float("nan")}, "number of standard deviations, got nan"),
        ({"outline": "hard", "samples": 2}, 'samples must be 1 with outline="hard"'),
    ],
)
def test_dial_that_is_not_allowed_is_refused(dials, message):
    with pytest.raises(ValueError, match=message):
        Effort(**dials)


KINDS = {
    "precision='half'": "precision must be one of float32, float64, None, got 'half'",
    "stride=1.5": "stride must be a whole number of at least 1, got 1.5",
    "all_starts=1": "all_starts must be a bool, got 1",
    "extent='part'": "extent must be one of frame, tile, got 'part'",
    "tolerance='1'": "tolerance must be a float, got '1'",
}


def test_dial_of_another_kind_is_refused_before_jax_is_there():
    # In a process of its own, whose annotations nothing checks.
    lines = ["import sys", "from impostor_jax.effort import Effort"]
    for given in KINDS:
        lines += ["try:", f"    Effort({given})"]
        lines += ["except ValueError as e:", "    print(e)"]
    lines.append("assert 'jax' not in sys.modules")
    found = subprocess.run(
        [sys.executable, "-c", "\n".join(lines)],
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.splitlines() == list(KINDS.values())


def test_presets_have_names_and_sentences():
    assert set(EFFORTS) == set(typing.get_args(EffortName))
    for name, (sentence, effort) in EFFORTS.items():
        assert sentence.endswith(".")
        assert effort_of(name) is effort
    assert effort_of(Effort(stride=2)) == Effort(stride=2)
    assert effort_of("balanced") == Effort()


@pytest.mark.parametrize("effort", ["slow", None, 3])
def test_what_is_no_effort_is_refused(effort):
    with pytest.raises(ValueError, match="effort must be an Effort or one of fast"):
        effort_of(effort)


def test_every_dial_has_a_flag_that_changes_a_preset():
    assert {f.name for f in dataclasses.fields(Dials)} == set(vars(Effort()))
    assert chosen_effort("fast", Dials()) == EFFORTS["fast"][1]
    changed = chosen_effort("fast", Dials(stride=1, kernel="cauchy"))
    assert (changed.stride, changed.kernel) == (1, "cauchy")
    assert changed.tolerance == EFFORTS["fast"][1].tolerance
