"""What made a result."""

import subprocess

import cv2
import jax

from impostor_jax.io import provenance


def test_versions_are_those_of_the_packages():
    versions = provenance.package_versions()
    assert versions["jax"] == jax.__version__
    assert versions["opencv"].startswith(cv2.__version__)
    assert set(versions) == {"python", "opencv", *provenance.PACKAGES}


def test_git_says_nothing_of_a_copy_that_is_no_part_of_a_tree(tmp_path, monkeypatch):
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    copy = tmp_path / "provenance.py"
    copy.write_text("")
    monkeypatch.setattr(provenance, "__file__", str(copy))
    assert provenance.git_output("rev-parse", "--show-toplevel") is None
    subprocess.run(["git", "add", "."], cwd=tmp_path, check=True)
    assert provenance.git_output("rev-parse", "--show-toplevel") == str(tmp_path)
