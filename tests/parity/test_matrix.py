"""The cases of the matrix on every implementation, by the command that users run."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from impostor_jax.__main__ import main
from impostor_jax.glsl import reference
from impostor_jax.glsl.cases import CAMERAS
from impostor_jax.glsl.known_differences import KNOWN_DIFFERENCES
from impostor_jax.glsl.parity import select
from tests.parity.as_users import draw

pytest.importorskip("moderngl")

# Softpipe and the browser run the shaders that llvmpipe compiles: of each kind one, of
# both cameras, some of them with known differences.
KINDS = (
    "oblique", "near, reaching behind", "sphere, distance 2", "inside a sphere",
    "frustum", "sector of less than half a turn", "box", "torus", "floor",
    "heightfield", "bicubic heightfield, among its peaks", "ten shapes",
)  # fmt: skip
SOME = tuple(f"{camera}/{kind}" for camera in CAMERAS for kind in KINDS)
CHOSEN = {"llvmpipe": ("all",), "softpipe": SOME, "webgl": SOME}

ROOT = Path(__file__).parents[2]


@pytest.fixture
def parity(tmp_path, monkeypatch, capfd):
    """Run the command; its exit code, what it wrote to the terminal and to its folder.

    In this process, which draws with llvmpipe and the browser and keeps what JAX
    compiled; softpipe needs a process of its own.
    """

    def run(*arguments):
        command = ["tests.parity.as_users", "parity", "--output", str(tmp_path)]
        command += arguments
        if "softpipe" in arguments:
            command = [sys.executable, "-m", *command]
            code = subprocess.run(command, cwd=ROOT).returncode
        else:
            monkeypatch.setattr(reference, "_closest", draw)
            monkeypatch.setattr(sys, "argv", command)
            try:
                code = main()
            except SystemExit as stop:
                code = stop.code
        said = capfd.readouterr()
        if code == 2 and "apt-get install" in said.err:
            pytest.skip(said.err)
        return code, said, tmp_path

    return run


def record_of(folder):
    return json.loads((folder / "parity.json").read_text())


@pytest.mark.parametrize("driver", CHOSEN)
def test_jax_and_the_driver_agree_on_every_case(driver, parity):
    if driver == "webgl":
        pytest.importorskip("playwright")
    code, said, folder = parity("--driver", driver, "--cases", *CHOSEN[driver])
    assert code == 0, said
    record = record_of(folder)
    assert record["holds"]
    names = {case.name for case in select(patterns=CHOSEN[driver])}
    assert {case["case"] for case in record["cases"]} == names
    assert all(case["num_hits"] > 20 for case in record["cases"])
    named = {"webgl": "SwiftShader"}.get(driver, driver)
    assert named in record["driver"]
    # A known difference that is none any more must leave the list.
    needed = {
        (case["case"], verdict["quantity"])
        for case in record["cases"]
        for verdict in case["verdicts"]
        if verdict["cause"]
    }
    listed = {(k.case, k.quantity) for k in KNOWN_DIFFERENCES if driver in k.drivers}
    assert needed == {known for known in listed if known[0] in names}
    table = (folder / "parity.md").read_text()
    count = 90 if driver == "llvmpipe" else len(KINDS)
    for camera in CAMERAS:
        assert table.count(f"\n| {camera}/") == count
    assert len(list(folder.glob("*.png"))) == len(names) == 2 * count


def test_published_formulas_break_parity(parity):
    chosen = ("perspective/oblique", "perspective/radius 0.01")
    code, _, folder = parity("--cases", *chosen, "--as-published")
    assert code == 1
    record = record_of(folder)
    assert not record["holds"]
    for case in record["cases"]:
        broken = {v["quantity"] for v in case["verdicts"] if v["value"] > v["bound"]}
        assert {"flips_off_band", "normal_deg.p999", "depth_ulp.p99"} <= broken


def test_every_known_difference_is_listed_with_its_cause():
    text = (Path(__file__).parent / "README.md").read_text()
    for known in KNOWN_DIFFERENCES:
        row = (
            f"| {known.case} | {known.quantity} | {known.bound:g} | "
            f"{', '.join(known.drivers)} | {known.cause} |"
        )
        assert row in text, row
    assert text.count("| perspective/") + text.count("| orthographic/") == len(
        KNOWN_DIFFERENCES
    )


def test_unknown_case_is_named_in_one_line(parity):
    code, said, _ = parity("--cases", "cone")
    assert code == 2
    assert said.err.startswith("impostor-jax: error: cases must match one of")
    assert said.err.count("\n") == 1
