"""Every experiment runs to its end with --quick."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.groups import LARGE_IMAGES

pytestmark = LARGE_IMAGES

ROOT = Path(__file__).parents[2]
EXPERIMENTS = sorted(path.parent.name for path in ROOT.glob("experiments/*/run.py"))


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_quick_run_writes_its_metrics(name, tmp_path):
    found = subprocess.run(
        [sys.executable, "-m", f"experiments.{name}.run", "--quick", "--output",
         str(tmp_path)],
        capture_output=True, text=True, cwd=ROOT, env=os.environ,
    )  # fmt: skip
    if found.returncode and "apt-get install" in found.stderr:
        pytest.skip(found.stderr)
    assert found.returncode == 0, found.stderr
    record = json.loads((tmp_path / "results.json").read_text())
    assert record["metrics"]
