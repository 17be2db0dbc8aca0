"""The cases of the matrix on every implementation, by the command that users run."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from experiments.published_faults.run import SHADERS
from impostor_jax.parity.cases import CAMERAS, select
from tests.groups import FULL, RELEASE

pytest.importorskip("moderngl")

pytestmark = FULL

# Of each kind one, some of them near the camera. With --release llvmpipe draws all, as
# `impostor-jax parity` does.
SOME = {
    "perspective": (
        "oblique", "near, reaching behind", "inside a sphere", "frustum", "torus",
        "triangle", "heightfield", "bored can", "cylinders and spheres",
    ),
    "orthographic": ("oblique", "sphere, distance 2"),
}  # fmt: skip
CORE = tuple(f"{camera}/{kind}" for camera in CAMERAS for kind in SOME[camera])
BROKEN = ("perspective/oblique", "perspective/radius 0.01")

ROOT = Path(__file__).parents[2]

# Commands one after the other in one process, for which JAX draws what they share once.
# Mesa takes one driver in a process.
TOGETHER = ("llvmpipe", "webgl", "published", "unknown")
COMMANDS = """
import contextlib, json, sys
from pathlib import Path
from impostor_jax.__main__ import main

folder, commands = Path(sys.argv[1]), json.loads(sys.argv[2])
for name, arguments in commands.items():
    sys.argv = ["impostor-jax", "parity", "--output", str(folder / name), *arguments]
    with (folder / f"{name}.log").open("w") as log, contextlib.redirect_stderr(log):
        try:
            code = main()
        except SystemExit as stop:
            code = stop.code
    (folder / f"{name}.code").write_text(str(code))
"""


@pytest.fixture(scope="module")
def chosen(pytestconfig):
    """Patterns of the cases that each driver draws."""
    patterns = dict.fromkeys(("llvmpipe", "softpipe", "webgl"), CORE)
    if pytestconfig.getoption("--release"):
        patterns["llvmpipe"] = tuple(case.name for case in select())
    return patterns


@pytest.fixture(scope="module")
def ended(chosen, tmp_path_factory, pytestconfig):
    """Exit code, standard error and folder of each command, as users type it."""
    folder = tmp_path_factory.mktemp("parity")
    commands = {
        driver: ["--driver", driver, "--cases", *patterns]
        for driver, patterns in chosen.items()
    }
    commands["published"] = ["--cases", *BROKEN, "--shaders", str(SHADERS)]
    commands["unknown"] = ["--cases", "cone"]
    # Rounding errors are promised of the code that users get, not of conftest's.
    settings = {k: v for k, v in os.environ.items() if k != "XLA_FLAGS"}
    is_release = pytestconfig.getoption("--release")
    for names in (TOGETHER, ("softpipe",)) if is_release else (TOGETHER,):
        mine = json.dumps({name: commands[name] for name in names})
        program = [sys.executable, "-c", COMMANDS, str(folder), mine]
        subprocess.run(program, cwd=ROOT, env=settings, check=True)

    def of(name):
        code = int((folder / f"{name}.code").read_text())
        errors = (folder / f"{name}.log").read_text()
        if code == 2 and "apt-get install" in errors:
            pytest.skip(errors)
        return code, errors, folder / name

    return of


def record_of(folder):
    return json.loads((folder / "parity.json").read_text())


@pytest.mark.parametrize(
    "driver", ["llvmpipe", pytest.param("softpipe", marks=RELEASE), "webgl"]
)
def test_jax_and_the_driver_agree_on_every_case(driver, ended, chosen):
    if driver == "webgl":
        pytest.importorskip("playwright")
    code, errors, folder = ended(driver)
    record = record_of(folder)
    broken = [case for case in record["cases"] if not case["holds"]]
    assert (code, errors, broken) == (0, "", [])
    assert record["holds"]
    names = {case.name for case in select(patterns=chosen[driver])}
    assert len(names) == (11 if chosen[driver] == CORE else len(select()))
    assert {case["case"] for case in record["cases"]} == names
    assert all(case["num_hits"] > 20 for case in record["cases"])
    named = {"webgl": "SwiftShader"}.get(driver, driver)
    assert named in record["driver"]
    table = (folder / "parity.md").read_text()
    for camera in CAMERAS:
        count = sum(name.startswith(f"{camera}/") for name in names)
        assert table.count(f"\n| {camera}/") == count
    assert len(list(folder.glob("*.png"))) == len(names)


def test_published_formulas_break_parity(ended):
    code, _, folder = ended("published")
    assert code == 1
    record = record_of(folder)
    assert not record["holds"]
    for case in record["cases"]:
        broken = {v["quantity"] for v in case["verdicts"] if v["value"] > v["bound"]}
        assert {"flips_off_band", "normal_deg.p999", "depth.worst"} <= broken


def test_unknown_case_is_named_in_one_line(ended):
    code, errors, _ = ended("unknown")
    assert code == 2
    assert errors.startswith("impostor-jax: error: cases must match one of")
    assert errors.count("\n") == 1
