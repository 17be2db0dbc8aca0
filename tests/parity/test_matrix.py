"""Every case of the matrix on every implementation, by the command that users run."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from impostor_jax.glsl.cases import CAMERAS, cases
from impostor_jax.glsl.known_differences import KNOWN_DIFFERENCES

pytest.importorskip("moderngl")


def parity(folder, *arguments):
    """The command's result, and what it wrote."""
    command = [sys.executable, "-m", "impostor_jax", "parity", "--output", str(folder)]
    found = subprocess.run([*command, *arguments], capture_output=True, text=True)
    if found.returncode == 2 and "apt-get install" in found.stderr:
        pytest.skip(found.stderr)
    assert found.returncode in (0, 1), found.stderr
    return found, json.loads((folder / "parity.json").read_text())


@pytest.mark.parametrize("driver", ["llvmpipe", "softpipe", "webgl"])
def test_jax_and_the_driver_agree_on_every_case(driver, tmp_path):
    if driver == "webgl":
        pytest.importorskip("playwright")
    found, record = parity(tmp_path, "--driver", driver)
    assert found.returncode == 0, found.stdout
    assert record["holds"]
    assert {case["case"] for case in record["cases"]} == {c.name for c in cases()}
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
    assert needed == listed
    table = (tmp_path / "parity.md").read_text()
    for camera in CAMERAS:
        assert table.count(f"\n| {camera}/") == len(cases(camera)) == 85
    assert len(list(tmp_path.glob("*.png"))) == len(cases())


def test_published_formulas_break_parity(tmp_path):
    found, record = parity(
        tmp_path, "--cases", "perspective/oblique", "perspective/radius 0.01",
        "--as-published",
    )  # fmt: skip
    assert found.returncode == 1
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


def test_unknown_case_is_named_in_one_line(tmp_path):
    command = [sys.executable, "-m", "impostor_jax", "parity", "--cases", "cone"]
    found = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert found.returncode == 2
    assert found.stderr.startswith("impostor-jax: error: cases must match one of")
    assert found.stderr.count("\n") == 1
