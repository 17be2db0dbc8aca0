"""What is written where: files are replaced, links followed, all else is written to."""

import json
import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from impostor_jax.io.atomic import (
    check_output_file,
    check_output_folder,
    write_json,
    write_text,
)

FULL = "/dev/full"
needs_full = pytest.mark.skipif(not os.path.exists(FULL), reason="no /dev/full")


def test_a_pipe_is_written_to_and_stays(tmp_path):
    path = tmp_path / "pipe.json"
    os.mkfifo(path)
    found = []
    reader = threading.Thread(target=lambda: found.append(path.read_text()))
    reader.start()
    check_output_file(path)
    write_json(path, {"a": 1})
    reader.join()
    assert json.loads(found[0]) == {"a": 1}
    assert stat.S_ISFIFO(path.stat().st_mode)


@needs_full
def test_a_full_device_is_an_error_and_stays():
    before = os.stat(FULL)
    with pytest.raises(OSError, match="No space left on device: '/dev/full'"):
        write_json(Path(FULL), {"a": 1})
    after = os.stat(FULL)
    assert stat.S_ISCHR(after.st_mode)
    assert (after.st_ino, after.st_rdev) == (before.st_ino, before.st_rdev)


def test_a_link_is_followed_and_stays(tmp_path):
    (tmp_path / "far").mkdir()
    target, link = tmp_path / "far" / "target.json", tmp_path / "link.json"
    link.symlink_to(target)
    for value in (1, 2):
        check_output_file(link)
        write_json(link, value)
        assert link.is_symlink()
        assert json.loads(target.read_text()) == value
    assert not target.is_symlink()
    assert [entry.name for entry in target.parent.iterdir()] == ["target.json"]


def test_a_file_that_is_replaced_keeps_its_rights(tmp_path):
    path = tmp_path / "mine.txt"
    path.write_text("old")
    path.chmod(0o600)
    write_text(path, "new")
    assert (path.read_text(), stat.S_IMODE(path.stat().st_mode)) == ("new", 0o600)


def test_a_dash_is_the_standard_output(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_output_file(Path("-"))
    write_json(Path("-"), [1])
    assert capsys.readouterr().out == "[\n  1\n]\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["-", "/dev/stdout", "/dev/fd/1", "out.txt"])
def test_the_standard_output_in_a_file_is_not_replaced(name, tmp_path):
    program = (
        "import sys; from pathlib import Path\n"
        "from impostor_jax.io.atomic import write_text\n"
        "print('before'); write_text(Path(sys.argv[1]), 'record\\n'); print('after')"
    )
    with (tmp_path / "out.txt").open("w") as file:
        subprocess.run(
            [sys.executable, "-c", program, name], stdout=file, cwd=tmp_path, check=True
        )
    assert (tmp_path / "out.txt").read_text() == "before\nrecord\nafter\n"


def test_a_file_needs_its_folder(tmp_path):
    with pytest.raises(ValueError, match="json must be a file in a folder that is"):
        check_output_file(tmp_path / "none" / "a.json", "json")
    with pytest.raises(ValueError, match="json must be a file, got the folder"):
        check_output_file(tmp_path, "json")
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(OSError, match="symbolic links"):
        check_output_file(tmp_path / "loop")
    assert [entry.name for entry in tmp_path.iterdir()] == ["loop"]


def test_a_folder_is_checked_and_not_made(tmp_path):
    check_output_folder(tmp_path / "a" / "b", ("x.png",))
    assert not list(tmp_path.iterdir())
    (tmp_path / "x.png").mkdir()
    with pytest.raises(ValueError, match=r"got the folder .*x\.png"):
        check_output_folder(tmp_path, ("x.png",))
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match="output must be a folder, got the file"):
        check_output_folder(tmp_path / "file")
    with pytest.raises(NotADirectoryError):
        check_output_folder(tmp_path / "file" / "below")


def test_a_folder_that_takes_no_files_is_refused():
    # Who runs as root may write everywhere but here.
    for folder in (Path("/proc"), Path("/proc/below")):
        with pytest.raises(OSError, match=r"can be made in the folder .*: '/proc'$"):
            check_output_folder(folder)
    with pytest.raises(OSError, match="/proc"):
        check_output_file(Path("/proc/a.json"))
