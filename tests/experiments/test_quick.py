"""Every experiment runs to its end with --quick, and its README has its numbers."""

import importlib
import json
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from experiments.markdown import tables_of
from experiments.recording import Results
from tests.groups import FULL, LARGE_IMAGES, RELEASE, SMALL_IMAGES

ROOT = Path(__file__).parents[2]
EXPERIMENTS = sorted(path.parent.name for path in ROOT.glob("experiments/*/run.py"))

SMALL = ("fit_speed", "synthetic_benchmark")
"""Those whose quick runs fit images of 160x120."""

LONG = (
    "averaged_images",
    "cross_ray_noise",
    "extremes",
    "find_accuracy",
    "find_clouds",
    "fit_outline",
    "fit_page",
    "fit_shapes",
    "fit_tubes",
    "fit_views",
    "golden",
    "graphics_card",
    "last_bit",
    "many_images",
    "mask_errors",
    "near_cylinders",
    "published_faults",
    "random_scenes",
    "ray_tracing",
    "real_images",
    "render_speed",
    "scene_descent",
    "sensor_models",
    "solids",
    "speed_accuracy",
    "stem_diameters",
    "synthetic_benchmark",
    "tracking",
)
"""Those that take 5 to 24 seconds; the others take 10 together."""


def marks_of(name):
    group = SMALL_IMAGES if name in SMALL else LARGE_IMAGES
    return (group, RELEASE) if name in LONG else (group,)


@FULL
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=marks_of(name)) for name in EXPERIMENTS]
)
def test_quick_run_writes_its_metrics(name, tmp_path, monkeypatch):
    # In this process, where another test may have compiled the same, or imported it.
    module = f"experiments.{name}.run"
    command = ["run", "--quick", "--output", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", command)
    monkeypatch.delitem(sys.modules, module, raising=False)
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        if "apt-get install" in str(end):
            pytest.skip(str(end))
        raise
    record = json.loads((tmp_path / "results.json").read_text())
    assert record["metrics"]
    # A library that is compiled for speed may switch them off, for all that follows.
    assert np.nextafter(0, 1) / 1 > 0


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_tables_of_the_readme_are_those_of_the_results(name):
    folder = ROOT / "experiments" / name
    report = importlib.import_module(f"experiments.{name}.report")
    readme = (folder / "README.md").read_text()
    assert tables_of(readme) == report.tables(Results.read(folder))
