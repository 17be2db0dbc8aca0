"""The command that every experiment is."""

import dataclasses
import json
import sys

import pytest
from matplotlib.figure import Figure

from experiments.markdown import number, percent, table, three_digits, with_tables
from experiments.recording import Metric
from experiments.running import RunConfig, main

README = """# Title

<!-- tables, written by the command -->
| old |
<!-- /tables -->

Limits.
"""


@dataclasses.dataclass(frozen=True)
class Config:
    run: RunConfig = RunConfig()
    seeds: int = 200
    seed: int = 0


def measure(config):
    assert config.run.output is not None
    yield Metric("seeds", config.seeds, 0.5, "1", "higher", config.seeds)
    yield Metric.share("share", 0.2, 100)


def draw(results):
    assert results.cases("s", "e") == ["shar"]
    return {"nothing": Figure()}


def tables(results):
    return table(["what", "found"], [["seeds", number(*results.pair("seeds")[:1])]])


def run(monkeypatch, *flags):
    monkeypatch.setattr(sys, "argv", ["run", *flags])
    main(Config, measure, tables, Config(seeds=2), draw)


def test_a_run_writes_results_figures_and_the_tables_of_its_readme(
    monkeypatch, tmp_path, capsys
):
    (tmp_path / "README.md").write_text(README)
    run(monkeypatch, "--quick", "--seeds", "7", "--output", str(tmp_path))
    record = json.loads((tmp_path / "results.json").read_text())
    assert record["config"] == {"seeds": 2, "seed": 0}
    assert [m["spread"] for m in record["metrics"]] == [0.5, pytest.approx(0.04)]
    assert (tmp_path / "figures" / "nothing.png").exists()
    written = "| what | found |\n|---|--:|\n| seeds | 2 |"
    assert (tmp_path / "README.md").read_text() == README.replace("| old |", written)
    assert written in capsys.readouterr().out


def test_less_than_one_of_a_thing_is_refused(monkeypatch):
    with pytest.raises(SystemExit, match="seeds must be at least 1, got 0"):
        run(monkeypatch, "--seeds", "0")


def test_numbers_that_are_unknown_are_left_blank():
    assert number(None) == percent(None) == three_digits(None) == ""
    assert number(1.234, ".1f", 0.06) == "1.2 (0.1)"
    assert three_digits(1234.5) == "1234"
    assert percent(0.1234) == "12.3 %"


def test_a_readme_without_marks_is_refused():
    with pytest.raises(ValueError, match="must have the marks"):
        with_tables("# Title\n", "| a |")
