"""What a command refuses, it refuses before JAX is imported, which takes seconds."""

import json
import subprocess
import sys

import cv2
import numpy as np

CAMERA = {"fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48}
FIT = ("fit", "depth.png", "--camera", "camera.json")
FIND = ("find", "depth.png", "--camera", "camera.json")
CALIBRATE = ("calibrate", "depth.png", "--camera", "camera.json")
EXPORT = ("export", "--output", "out.stl")
RENDER = ("render", "--output", "out")
CYLINDER = ("--center", "0", "0", "1", "--axis", "0", "1", "0", "--radius", "0.1")
GENERATE = ("generate", "--output", "out", "--count", "3", "--preset")
# What is typed, and what is said.
REFUSED = {
    "impostor_jax": (
        (("fit", "none.png", "--camera", "camera.json"), "does not exist"),
        (("fit", "depth.png", "--camera", "none.json"), "does not exist"),
        (("fit", "depth.png", "--camera", "broken.json"), "not readable JSON"),
        (("fit", "depth.png", "--camera", "none.yaml"), "does not exist"),
        (("fit", "depth.jpg", "--camera", "camera.json"), "must be a .png"),
        (("fit", "cut.png", "--camera", "camera.json"), "not a readable image"),
        (("fit", "cut.tiff", "--camera", "camera.json"), "not a readable image"),
        (("fit", "small.png", "--camera", "camera.json"), "must have the camera's"),
        ((*FIT, "--mask", "none.png"), "does not exist"),
        ((*FIT, "--labels", "small.png"), "must have the camera's shape"),
        ((*FIT, "--labels", "depth.png", "--mask", "depth.png"), "--mask must not"),
        ((*FIT, "--initial", "none.json"), "does not exist"),
        ((*FIT, "--sensor", "none.json"), "does not exist"),
        ((*FIT, "--sigma", "-1"), "sigma must be a positive number"),
        ((*FIT, "--samples", "2", "--outline", "hard"), "samples must be 1"),
        (("find", "none.png", "--camera", "camera.json"), "does not exist"),
        (("find", "cut.png", "--camera", "camera.json"), "not a readable"),
        (("find", "depth.png", "none.png", "--camera", "camera.json"), "not exist"),
        ((*FIND, "--sensor", "broken.json"), "not readable JSON"),
        ((*CALIBRATE, "--masks", "none.png"), "does not exist"),
        ((*CALIBRATE, "--radius", "1"), "--objects and --radius must be given"),
        ((*RENDER, "none.json"), "does not exist"),
        ((*RENDER, "broken.json"), "not readable JSON"),
        ((*RENDER, "camera.json"), "lacks version, shapes"),
        ((*RENDER, *CYLINDER, "--camera", "none.json"), "--height must be given"),
        ((*RENDER, *CYLINDER, "--height", "1"), "camera must be given"),
        ((*EXPORT, "none.json"), "does not exist"),
        ((*EXPORT, "camera.json"), "lacks version, shapes"),
        ((*EXPORT, "camera.json", "--scale", "0"), "scale must be a positive number"),
        (("export", "camera.json", "--output", "out.step"), "output must end in"),
        (("track", "none"), "does not exist"),
        (("track", ".", "--output", "tracks.txt"), "output must end with .csv"),
        (("track", ".", "--sigma", "0"), "sigma must be a positive number"),
        (("evaluate", "none"), "does not exist"),
        (("evaluate", "dataset"), "'dataset/train/000000' is missing"),
        (("evaluate", "dataset", "--limit", "0"), "limit must be a whole number"),
    ),
    "data_synth": (
        ((*GENERATE, "none.json"), "does not exist"),
        ((*GENERATE, "bench", "--sensor", "none.json"), "does not exist"),
        ((*GENERATE, "bench", "--shard-size", "0"), "shard_size must be"),
        (("resume", "none"), "does not exist"),
        (("validate", "none"), "does not exist"),
        (("preview", "none"), "does not exist"),
        (("describe", "none.json"), "does not exist"),
    ),
}
# All in one process, since each would take a third of a second.
PROGRAM = """
import importlib, json, sys
main = importlib.import_module(sys.argv[1] + ".__main__").main
for arguments in json.loads(sys.argv[2]):
    sys.argv[1:] = arguments
    code = main()
    late = [n for n in ("jax", "equinox", "matplotlib") if n in sys.modules]
    print(code, late, file=sys.stderr)
"""


def test_what_is_refused_is_refused_without_jax(tmp_path):
    (tmp_path / "camera.json").write_text(json.dumps(CAMERA | {"depth_scale_m": 1e-4}))
    (tmp_path / "broken.json").write_text("{")
    depth = np.full((48, 64), 5000, np.uint16)
    for name in ("depth.png", "cut.png", "cut.tiff"):
        cv2.imwrite(str(tmp_path / name), depth)
    for name in ("cut.png", "cut.tiff"):
        data = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(data[: 30 if name == "cut.png" else 4])
    cv2.imwrite(str(tmp_path / "small.png"), depth[:9])
    (tmp_path / "dataset").mkdir()
    manifest = {"count": 3, "shard_size": 2, "layout": "bop"}
    (tmp_path / "dataset" / "manifest.json").write_text(json.dumps(manifest))
    for package, refused in REFUSED.items():
        typed = json.dumps([arguments for arguments, _ in refused])
        found = subprocess.run(
            [sys.executable, "-c", PROGRAM, package, typed],
            capture_output=True,
            text=True,
            cwd=tmp_path,
        )
        lines = found.stderr.splitlines()
        assert len(lines) == 2 * len(refused), found.stderr
        for (arguments, message), error, end in zip(
            refused, lines[::2], lines[1::2], strict=True
        ):
            assert message in error, arguments
            assert end == "2 []", arguments
    assert not (tmp_path / "out").exists()
