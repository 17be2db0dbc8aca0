"""The cases of the matrix on every implementation, by the command that users run."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from experiments.published_faults.run import SHADERS
from impostor_jax.parity.cases import CAMERAS, select

pytest.importorskip("moderngl")

# Of each kind one, of both cameras, some of them near the camera. With --full llvmpipe
# draws all; softpipe and the browser run the shaders that it compiles.
KINDS = (
    "oblique", "near, reaching behind", "sphere, distance 2", "inside a sphere",
    "frustum", "sector of less than half a turn", "box", "torus", "floor",
    "heightfield", "bicubic heightfield, among its peaks", "ten shapes",
)  # fmt: skip
SOME = tuple(f"{camera}/{kind}" for camera in CAMERAS for kind in KINDS)
DRIVERS = ("llvmpipe", "softpipe", "webgl")

ROOT = Path(__file__).parents[2]


@pytest.fixture
def parity(tmp_path):
    """Run the command as users do; its result, and the folder that it wrote to."""

    def run(*arguments):
        # Rounding errors are promised of the code that users get, not of conftest's.
        settings = {k: v for k, v in os.environ.items() if k != "XLA_FLAGS"}
        command = [sys.executable, "-m", "impostor_jax", "parity"]
        command += ["--output", str(tmp_path), *arguments]
        done = subprocess.run(
            command, cwd=ROOT, env=settings, capture_output=True, text=True
        )
        if done.returncode == 2 and "apt-get install" in done.stderr:
            pytest.skip(done.stderr)
        return done, tmp_path

    return run


def record_of(folder):
    return json.loads((folder / "parity.json").read_text())


@pytest.mark.parametrize("driver", DRIVERS)
def test_jax_and_the_driver_agree_on_every_case(driver, parity, pytestconfig):
    if driver == "webgl":
        pytest.importorskip("playwright")
    is_full = driver == "llvmpipe" and pytestconfig.getoption("--full")
    chosen = ("all",) if is_full else SOME
    done, folder = parity("--driver", driver, "--cases", *chosen)
    assert done.returncode == 0, done.stdout + done.stderr
    record = record_of(folder)
    assert record["holds"]
    names = {case.name for case in select(patterns=chosen)}
    assert {case["case"] for case in record["cases"]} == names
    assert all(case["num_hits"] > 20 for case in record["cases"])
    named = {"webgl": "SwiftShader"}.get(driver, driver)
    assert named in record["driver"]
    table = (folder / "parity.md").read_text()
    count = 90 if is_full else len(KINDS)
    for camera in CAMERAS:
        assert table.count(f"\n| {camera}/") == count
    assert len(list(folder.glob("*.png"))) == len(names) == 2 * count


def test_published_formulas_break_parity(parity):
    chosen = ("perspective/oblique", "perspective/radius 0.01")
    done, folder = parity("--cases", *chosen, "--shaders", SHADERS)
    assert done.returncode == 1
    record = record_of(folder)
    assert not record["holds"]
    for case in record["cases"]:
        broken = {v["quantity"] for v in case["verdicts"] if v["value"] > v["bound"]}
        assert {"flips_off_band", "normal_deg.p999", "depth.worst"} <= broken


def test_unknown_case_is_named_in_one_line(parity):
    done, _ = parity("--cases", "cone")
    assert done.returncode == 2
    assert done.stderr.startswith("impostor-jax: error: cases must match one of")
    assert done.stderr.count("\n") == 1
