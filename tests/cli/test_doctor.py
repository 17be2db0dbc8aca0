"""The report of `impostor-jax doctor`, which is printed whatever is missing."""

import re
import subprocess
import sys

import cv2
import jax
import pytest

from impostor_jax.cli import doctor_command
from impostor_jax.cli.parse import parse


def report(capsys):
    assert parse(["doctor"]).run() == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    return printed.out


def test_a_report_tells_versions_devices_and_the_cache(capsys, monkeypatch, tmp_path):
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "program").write_bytes(bytes(2_500_000))
    monkeypatch.setenv("HOME", str(tmp_path.parent))
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    text = report(capsys)
    assert re.search(r"^version +\d", text, re.M)
    assert re.search(rf"^jax +{re.escape(jax.__version__)}$", text, re.M)
    assert re.search(rf"^OpenCV +{re.escape(cv2.__version__)}$", text, re.M)
    assert re.search(r"^device +cpu 0: cpu$", text, re.M)
    assert re.search(r"^OpenGL +\S", text, re.M)
    assert re.search(r"^extra gl +moderngl \S+, playwright \S+$", text, re.M)
    assert re.search(rf"^cache +~/{tmp_path.name}, 1 files of 2.5 MB$", text, re.M)
    assert "extra test" not in text


@pytest.mark.parametrize(
    ("program", "message"),
    [
        ("raise RuntimeError('no display')", "none (RuntimeError: no display)"),
        ("import os; os._exit(3)", "none (exit code 3)"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "exit code -11"),
        ("import time; time.sleep(60)", "no answer in 1 s"),
    ],
)
def test_a_report_goes_on_where_a_driver_does_not(
    program, message, capsys, monkeypatch, tmp_path
):
    monkeypatch.setattr(doctor_command, "DEVICES", "print('cpu 0: cpu')")
    monkeypatch.setattr(doctor_command, "DRIVERS", program)
    monkeypatch.setattr(doctor_command, "DISTRIBUTION", "none-of-this-name")
    # The program of a device needs longer to start where much else runs.
    if "sleep" in program:
        monkeypatch.setattr(doctor_command, "LONGEST_S", 1.0)
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path / "none"))
    text = report(capsys)
    assert re.search(r"^version +not installed$", text, re.M)
    assert message in text
    assert "0 files" in text


def test_a_report_imports_no_jax_itself():
    program = (
        "import sys\n"
        "from impostor_jax.cli import doctor_command\n"
        "doctor_command.DEVICES = doctor_command.DRIVERS = 'print(1)'\n"
        "doctor_command.DoctorCommand().run()\n"
        "assert 'jax' not in sys.modules"
    )
    found = subprocess.run([sys.executable, "-c", program], capture_output=True)
    assert (found.returncode, found.stderr) == (0, b"")
