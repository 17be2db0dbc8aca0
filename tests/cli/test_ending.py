"""How commands end: exit codes, and one line where something is wrong."""

import json
import os
import signal
import stat
import subprocess
import sys

import cv2
import numpy as np
import pytest

import impostor_jax.io.dataset_manifest
import impostor_jax.many.tasks
from impostor_jax.__main__ import main

# A shell lets what it runs in the background ignore interrupts.
LISTEN = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"

CAMERA = {"fx": 150.0, "fy": 150.0, "cx": 19.5, "cy": 14.5, "width": 40, "height": 30}


@pytest.fixture
def call(monkeypatch, capfd):
    """Run a command in this process; its exit code and what it printed to stderr."""

    def run_here(*arguments):
        monkeypatch.setattr(sys, "argv", ["impostor-jax", *map(str, arguments)])
        return main(), capfd.readouterr().err

    return run_here


@pytest.fixture
def image(tmp_path, monkeypatch):
    """Arguments of a fit, in whose place something else is called."""
    np.save(tmp_path / "depth.npy", np.ones((30, 40)))
    (tmp_path / "camera.json").write_text(json.dumps(CAMERA))
    return tmp_path / "depth.npy", "--camera", tmp_path / "camera.json"


def write_bad_files(folder):
    """Files that no command takes."""
    header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (400000, 400000), }"
    size = len(header).to_bytes(2, "little")
    (folder / "huge.npy").write_bytes(b"\x93NUMPY\x01\x00" + size + header)
    np.savez(folder / "archive.npz", depth=np.ones((30, 40)))
    (folder / "archive.npz").rename(folder / "archive.npy")
    far = np.ones((30, 40))
    far[3, 4] = 1e300
    np.save(folder / "far.npy", far)
    good, spoiled = np.ones((30, 40), np.uint16), folder / "spoiled.png"
    cv2.imwrite(str(spoiled), good)
    data = bytearray(spoiled.read_bytes())
    data[50] ^= 255
    spoiled.write_bytes(data)
    cv2.imwrite(str(folder / "mask.jpg"), good.astype(np.uint8))
    cv2.imwrite(str(folder / "mask.tiff"), good.astype(np.float32))
    (folder / "deep.json").write_text('{"a":' * 50000)
    for name, change in (
        ("wide", {"width": 10**12}), ("long", {"fx": 1e300}),
        ("true", {"depth_scale_m": True}),
    ):  # fmt: skip
        (folder / f"{name}.json").write_text(json.dumps(CAMERA | change))
    os.mkfifo(folder / "pipe.npy")
    (folder / "loop.npy").symlink_to("loop.npy")


RENDER = "render --center 0 0 1 --axis 0 1 0 --height 1 --output out --camera"


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("fit huge.npy --camera camera.json", "depth image must have the camera's"),
        ("fit archive.npy --camera camera.json", "is not a readable NPY file"),
        ("fit far.npy --camera camera.json", "depth must be at most 1.84e+19 meters"),
        ("fit spoiled.png --camera camera.json", "its pixels are broken"),
        ("fit pipe.npy --camera camera.json", "must be a file, got a pipe"),
        ("fit loop.npy --camera camera.json", "Too many levels of symbolic links"),
        ("fit none/*.png --camera camera.json", "must match depth images, got none"),
        ("fit depth.npy --camera . --output out", "must be a file, got a folder"),
        ("fit depth.npy --camera deep.json", "nested more than 100 deep"),
        ("fit depth.npy --camera wide.json", "width and height must be at most"),
        ("fit depth.npy --camera long.json", "fx must be a positive number in pixels"),
        ("fit depth.npy --camera true.json", "depth_scale_m must be a positive numb"),
        ("fit depth.npy --camera camera.json --mask mask.jpg", "got a JPEG file"),
        ("fit depth.npy --camera camera.json --mask mask.tiff", "must hold integers"),
        (f"{RENDER} camera.json --radius 1e30", "radius must be meters of at most"),
        (f"{RENDER} camera.json --radius 1e300", "radius must be meters of at most"),
    ],
)
def test_bad_files_are_one_line_that_names_them(
    command, message, image, call, tmp_path, monkeypatch
):
    write_bad_files(tmp_path)
    before = {path.name for path in tmp_path.iterdir()}
    monkeypatch.chdir(tmp_path)
    code, error = call(*command.split())
    assert code == 2
    (line,) = error.splitlines()
    assert line.startswith("impostor-jax: error: ")
    assert message in line
    assert {path.name for path in tmp_path.iterdir()} == before


def refuse(*arguments, **options):
    raise AssertionError("the fit was begun")


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (("--json", "{folder}/none/a.json"), "a folder that is there"),
        (("--json", "{folder}"), "json must be a file, got the folder"),
        (("--json", "/proc/a.json"), "/proc"),
        (("--output", "/proc/out"), "/proc"),
        (("--output", "{folder}/depth.npy"), "output must be a folder, got the file"),
        (("--output", "{folder}/taken"), "got the folder"),
    ],
)
def test_an_output_that_cannot_be_written_is_found_before_the_fit(
    flags, message, image, call, tmp_path, monkeypatch
):
    monkeypatch.setitem(impostor_jax.many.tasks.FITS, "cylinder", refuse)
    (tmp_path / "taken" / "overlay.png").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    code, error = call("fit", *image, *(f.format(folder=tmp_path) for f in flags))
    assert code == 2
    (line,) = error.splitlines()
    assert line.startswith("impostor-jax: error: ")
    assert message in line
    assert {p.name for p in tmp_path.iterdir()} == {"taken", "depth.npy", "camera.json"}


def interrupt(*arguments, **options):
    raise KeyboardInterrupt


def test_an_interrupted_fit_ends_with_one_line(image, call, tmp_path, monkeypatch):
    monkeypatch.setitem(impostor_jax.many.tasks.FITS, "cylinder", interrupt)
    found = call("fit", *image, "--output", tmp_path / "out")
    assert found == (130, "impostor-jax: error: interrupted\n")
    assert not (tmp_path / "out").exists()


def test_an_interrupted_evaluation_ends_with_one_line(call, monkeypatch):
    monkeypatch.setattr(impostor_jax.io.dataset_manifest, "read_manifest", interrupt)
    found = call("evaluate", "cans")
    assert found == (130, "impostor-jax: error: interrupted\n")


@pytest.mark.parametrize(
    "command",
    [
        f"{RENDER} camera.json --radius 0.1".replace(" out ", " /proc/out "),
        "demo --output /proc/out",
        "evaluate cans --json /proc/a.json",
        "parity --output /proc/out",
    ],
)
def test_every_command_finds_an_output_that_cannot_be_written(
    command, image, call, tmp_path, monkeypatch
):
    monkeypatch.setattr("impostor_jax.rendering.render.render", refuse)
    monkeypatch.chdir(tmp_path)
    code, error = call(*command.split())
    assert code == 2
    (line,) = error.splitlines()
    assert "/proc" in line


def test_ctrl_c_ends_the_process_with_one_line():
    program = (
        f"{LISTEN}; import sys, time\n"
        "from impostor_jax.cli.fit_command import FitCommand\n"
        "from impostor_jax.__main__ import main\n"
        "FitCommand.run = lambda self: print('ready', flush=True) or time.sleep(60)\n"
        "sys.argv = ['impostor-jax', 'fit', 'a.png', '--camera', 'a.json']\n"
        "sys.exit(main())"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert (process.returncode, error) == (130, "impostor-jax: error: interrupted\n")


def test_an_interrupt_of_what_must_not_raise_is_not_lost():
    program = (
        f"{LISTEN}; import sys, time\n"
        "from impostor_jax.cli.fit_command import FitCommand\n"
        "from impostor_jax.__main__ import main\n"
        "class Left:\n"
        "    def __del__(self): raise KeyboardInterrupt\n"
        "FitCommand.run = lambda self: Left() and time.sleep(60)\n"
        "sys.argv = ['impostor-jax', 'fit', 'a.png', '--camera', 'a.json']\n"
        "sys.exit(main())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60
    )
    assert done.stderr == "impostor-jax: error: interrupted\n"
    assert done.returncode == 130


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
def test_a_full_standard_output_is_an_error():
    program = (
        "import sys; from impostor_jax.cli.fit_command import FitCommand\n"
        "from impostor_jax.__main__ import main\n"
        "FitCommand.run = lambda self: print('fitted') or 0\n"
        "sys.argv = ['impostor-jax', 'fit', 'a.png', '--camera', 'a.json']\n"
        "sys.exit(main())"
    )
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-c", program],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert done.returncode == 2
    assert done.stderr == ("impostor-jax: error: [Errno 28] No space left on device\n")
    assert stat.S_ISCHR(os.stat("/dev/full").st_mode)


@pytest.mark.parametrize(
    ("module", "arguments"),
    [
        ("data_synth", ["describe"]),
        ("impostor_jax", ["fit", "--help"]),
        ("impostor_jax", ["--version"]),
    ],
)
@pytest.mark.parametrize("buffering", [[], ["-u"]])
def test_output_that_nobody_reads_ends_a_command_quietly(module, arguments, buffering):
    # `impostor-synth describe | head` printed that the pipe was broken.
    reading, writing = os.pipe()
    os.close(reading)
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    done = subprocess.run(
        [sys.executable, *buffering, "-m", module, *arguments],
        stdout=writing,
        stderr=subprocess.PIPE,
        env=environment,
        text=True,
    )
    os.close(writing)
    assert (done.returncode, done.stderr) == (141, "")
