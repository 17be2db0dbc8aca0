"""Examples of the READMEs for users run as they stand, one after the other."""

import contextlib
import io
import re
import textwrap
from pathlib import Path

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.io.camera_file import write_camera
from tests.groups import FULL, LARGE_IMAGES, RELEASE

ROOT = Path(__file__).parent.parent
READMES = [
    ROOT / "README.md",
    *sorted((ROOT / "impostor_jax").rglob("README.md")),
    ROOT / "data_synth" / "README.md",
]


def blocks(path):
    """Its blocks of Python, each below as many empty lines as stand before it."""
    text = path.read_text()
    for found in re.finditer(r"^( *)```python\n(.*?)^\1```$", text, re.M | re.S):
        above = text[: found.start(2)].count("\n")
        yield "\n" * above + textwrap.dedent(found[2])


WITH_EXAMPLES = [path for path in READMES if any(blocks(path))]


def frames(path):
    """A folder of one depth image, and the file of its camera beside it."""
    camera = ij.PinholeCamera(150.0, 150.0, 79.5, 59.5, 160, 120)
    can = ij.Cylinder((0.0, 0.0, 0.8), (0.3, 0.8, 0.52), 0.04, 0.12)
    scene = ij.Scene([can, ij.Plane((0, 0, 1.2), (0, 0, -1))])
    path.mkdir()
    np.save(path / "first.npy", np.asarray(ij.render(scene, camera).depth))
    write_camera(path.parent / "camera.json", camera, None)


def scan(path):
    """A stem of 1200 points, half of it seen, above a sensor's origin."""
    laspy = pytest.importorskip("laspy")
    rng = np.random.default_rng(0)
    angle, along = rng.uniform(-1.2, 1.2, 1200), rng.uniform(-1, 1, 1200)
    radius = rng.normal(0.15, 0.002, 1200)
    file = laspy.create(point_format=3, file_version="1.4")
    file.header.scales = [1e-4] * 3
    file.x = 4 - radius * np.cos(angle)
    file.y, file.z = radius * np.sin(angle), 1.7 + along
    file.write(path)


FILES = {"frames": frames, "scan.laz": scan, "plot.laz": scan}
"""What an example may read, and what makes it."""

UNKNOWN = r"\b(inf|nan)\b|failed"
"""What is printed of numbers that nothing tells, and of images that are broken."""

# Those that the command line is tested with have compiled the same fits.
pytestmark = LARGE_IMAGES


def printed_by(programs, path):
    """What programs print that go on from each other."""
    namespace, printed = {"__name__": "__main__"}, io.StringIO()
    with contextlib.redirect_stdout(printed):
        for program in programs:
            exec(compile(program, str(path), "exec"), namespace)
    return printed.getvalue()


def test_the_first_example_knows_the_center_and_sees_the_height_whole():
    first, *_ = blocks(ROOT / "README.md")
    text = printed_by([first], ROOT / "README.md")
    assert "seen whole: True" in text
    assert not re.search(UNKNOWN, text)


# Those of the first page are what is read most.
@pytest.mark.parametrize(
    "path",
    [
        pytest.param(
            path,
            id=str(path.relative_to(ROOT)),
            marks=FULL if path.parent == ROOT else RELEASE,
        )
        for path in WITH_EXAMPLES
    ],
)
def test_examples_run_as_they_stand(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    programs = [*blocks(path)]
    for name, make in FILES.items():
        if any(f'"{name}"' in program for program in programs):
            make(tmp_path / name)
    assert not re.search(UNKNOWN, printed_by(programs, path))


def test_the_first_page_shows_no_pictures():
    # It is also the description in the package's metadata, beside which there are no
    # files.
    assert "![" not in (ROOT / "README.md").read_text()
