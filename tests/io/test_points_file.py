"""Point clouds: files that other programs wrote, and files that are none."""

import itertools
import re
import struct
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.io import point_cloud, points_file

for needed in ("laspy", "lazrs", "lzf"):
    pytest.importorskip(needed)

DATA = Path(__file__).parent / "data"
TURN = 0.7 * np.arange(20)
POINTS = np.stack(
    [
        0.1 + 0.05 * np.cos(TURN),
        0.2 + 0.05 * np.sin(TURN),
        0.9 + 0.01 * np.arange(20),
    ],
    axis=1,
)
ORIGIN = [0.5, 0.25, -1.0]
PLACE = [500000.0, 5400000.0, 300.0]
"""Where the LAS files are."""

ALL = sorted(path.name for path in DATA.iterdir() if path.suffix != ".md")


def read(name):
    return ij.io.read_points(DATA / name)


@pytest.mark.parametrize("name", ALL)
def test_points_of_other_programs_are_read(name):
    cloud = read(name)
    place = PLACE if name.startswith("laspy") else [0.0, 0.0, 0.0]
    # Half a unit of a LAS file is 5e-5 m; others have six digits at least.
    tolerance = 5.1e-5 if name.startswith("laspy") else 6e-7
    assert cloud.points.dtype == np.float64
    np.testing.assert_allclose(cloud.points - place, POINTS, rtol=0, atol=tolerance)


@pytest.mark.parametrize("name", ALL)
def test_the_sensor_is_where_the_file_says(name):
    origin = read(name).origin
    if name.startswith("pcl") and name.endswith("pcd"):
        np.testing.assert_allclose(origin, ORIGIN)
    else:
        # Open3D and `pcl_pcd2ply` know of no position, and write the default.
        assert origin is None


def test_a_scale_takes_points_and_origin_to_meters(tmp_path):
    rows = np.concatenate([POINTS, POINTS - 1], axis=1)
    np.save(tmp_path / "a.npy", 1000 * rows)
    cloud = ij.read_points(str(tmp_path / "a.npy"), scale=0.001)
    np.testing.assert_allclose(cloud.points, POINTS, rtol=1e-12)
    np.testing.assert_allclose(cloud.origin, POINTS - 1, rtol=1e-12)


@pytest.mark.parametrize(
    "values",
    [
        POINTS,
        POINTS.astype(">f4"),
        np.asfortranarray(POINTS),
        POINTS.reshape(4, 5, 3),
        np.array(
            [(k, *p) for k, p in enumerate(POINTS)],
            [("id", "i4"), ("x", "f8"), ("y", "f8"), ("z", "f8")],
        ),
    ],
    ids=["double", "single, big-endian", "by columns", "of an image", "records"],
)
def test_arrays_are_read(values, tmp_path):
    np.save(tmp_path / "a.npy", values)
    cloud = ij.io.read_points(tmp_path / "a.npy")
    np.testing.assert_allclose(cloud.points, POINTS, atol=1e-7)
    assert cloud.origin is None


def test_missing_points_and_their_origins_are_left_out(tmp_path):
    rows = np.concatenate([POINTS, POINTS - 1], axis=1)
    rows[3, 1], rows[5, 4] = np.nan, np.nan
    np.save(tmp_path / "a.npy", rows)
    with pytest.raises(ValueError, match="must hold finite positions of the sensor"):
        ij.io.read_points(tmp_path / "a.npy")
    rows[5, 0] = np.inf
    np.save(tmp_path / "a.npy", rows)
    cloud = ij.io.read_points(tmp_path / "a.npy")
    assert len(cloud.points) == len(cloud.origin) == 18
    np.testing.assert_allclose(cloud.points - cloud.origin, np.ones((18, 3)))


@pytest.mark.parametrize(
    "text",
    [
        "1 2 3\n4 5 6\n",
        "\n# made by hand\n1\t2  3 255 0 0\n4 5 6 0 0 0",
        "1,2,3\r\n4,5,6\r\n",
        "1, 2, 3,, a\n4, 5, 6,, b\n",
        "1;2;3\n4;5;6\n",
        "1,0;2,000;3,0\n4,0;5,0;6,0\n",
        "//X,Y,Z,R,G,B\n1,2,3,0,0,0\n4,5,6,0,0,0\n",
        '"id","z","X","y"\n7,3,1,2\n8,6,4,5\n',
        "x y z\n1 2 3\n4 5 6\n",
        "name;x;y;z\nfirst;1;2;3\nsecond;4;5;6\n",
        "2\n1 2 3 -5 0 0 0\n4 5 6 -5 0 0 0\n",
        "\ufeff1 2 3\n4 5 6 # and so on\nnan nan nan\n",
    ],
    ids=[
        "spaces", "tabs and colors", "commas", "text beside", "semicolons",
        "decimal commas", "CloudCompare", "by names", "a line of names",
        "names of points", "with a count", "with a mark",
    ],
)  # fmt: skip
@pytest.mark.parametrize("suffix", [".xyz", ".TXT"])
def test_text_is_read(text, suffix, tmp_path):
    path = tmp_path / f"a{suffix}"
    path.write_text(text, encoding="utf-8")
    np.testing.assert_array_equal(
        ij.io.read_points(path).points, [[1, 2, 3], [4, 5, 6]]
    )


def pcd(data="ascii", body=b"", **changes):
    """A PCD file whose header says what one likes."""
    entries = {
        "VERSION": "0.7", "FIELDS": "x y z", "SIZE": "4 4 4", "TYPE": "F F F",
        "COUNT": "1 1 1", "WIDTH": "2", "HEIGHT": "1",
        "VIEWPOINT": "0 0 0 1 0 0 0", "POINTS": "2",
    } | changes  # fmt: skip
    lines = [f"{key} {value}" for key, value in entries.items() if value is not None]
    return "\n".join([*lines, f"DATA {data}", ""]).encode() + body


PLY = """ply
format ascii 1.0
comment 	of a scanner
element grid 2
property list uchar int ids
property float a
element vertex 2
property double y
property float64 x
property uchar red
property float z
property list uchar int neighbors
element face 1
property list uchar int vertex_indices
element camera 1
property float view_px
property float view_py
property float view_pz
property float k1
end_header
2 1 2 0.5
0 0.5
2 1 255 3 1 0
5 4 255 6 2 0 1
3 0 1 0
0.5 0.25 -1 0
"""


def test_corners_of_a_ply_file_stand_anywhere(tmp_path):
    (tmp_path / "a.ply").write_text(PLY)
    cloud = ij.io.read_points(tmp_path / "a.ply")
    np.testing.assert_array_equal(cloud.points, TWO)
    np.testing.assert_array_equal(cloud.origin, ORIGIN)


TWO = np.array([[1, 2, 3], [4, 5, 6]], "<f4")


@pytest.mark.parametrize(
    "data",
    [
        pcd(body=b"1 2 3\n4 5 6\n"),
        pcd(body=b"1  2 3\r\n4 5 6", COUNT=None, VIEWPOINT=None, POINTS=None),
        pcd("binary", TWO.tobytes() + bytes(4000)),
        # As Velodyne's drivers write it: with gaps, and integers of other sizes.
        pcd(
            "binary",
            b"".join(b"abc" + row.tobytes() + bytes(6) for row in TWO),
            FIELDS="_ x y z _ ring", SIZE="1 4 4 4 1 2", TYPE="U F F F U U",
            COUNT="3 1 1 1 4 1",
        ),
        pcd(
            "binary", TWO.astype("<f8").tobytes(), SIZE="8 8 8",
            WIDTH="1", HEIGHT="2",
        ),
    ],
)  # fmt: skip
def test_other_pcd_files_are_read(data, tmp_path):
    (tmp_path / "a.pcd").write_bytes(data)
    cloud = ij.io.read_points(tmp_path / "a.pcd")
    np.testing.assert_array_equal(cloud.points, TWO)
    assert cloud.origin is None


def ply(counts, rows=b"", more=b""):
    return (
        b"ply\nformat ascii 1.0\nelement vertex " + counts
        + b"\nproperty float x\nproperty float y\nproperty float z\n" + more
        + b"end_header\n" + rows
    )  # fmt: skip


def npy(values):
    values = np.asarray(values)
    header = f"{{'descr': '{values.dtype.str}', 'fortran_order': False, 'shape': "
    header += f"{values.shape}, }}"
    size = struct.pack("<H", len(header))
    return b"\x93NUMPY\x01\x00" + size + header.encode() + values.tobytes()


def las(**changes):
    """A LAS file whose header says what one likes."""
    data = bytearray((DATA / "laspy.las").read_bytes())
    for place, value in changes.items():
        k = int(place[1:])
        data[k : k + len(value)] = value
    return bytes(data)


GOOD = {name: (DATA / name).read_bytes() for name in ALL}
MOST = struct.pack("<Q", 10**12)


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.ply", b"", "it begins with no 'ply'"),
        ("a.ply", b"hello", "it begins with no 'ply'"),
        ("a.ply", b"ply\nformat ascii 1.0\n", "its header has no end"),
        ("a.ply", b"ply\n" + b"comment a\n" * 20000, "its header has no end"),
        ("a.ply", b"ply\nend_header\n", "it has the line 'end_header'"),
        ("a.ply", b"ply\nformat gzip 1.0\n", "it has the line 'format gzip 1.0'"),
        ("a.ply", b"ply\nproperty float x\n", "it has the line 'property float x'"),
        ("a.ply", ply(b"-1"), "it has the line 'element vertex -1'"),
        ("a.ply", ply(b"2", b"1 2 3\n"), "vertex must have 2 lines, got 1"),
        ("a.ply", ply(b"1", b"1 2 a\n"), "could not convert string 'a'"),
        ("a.ply", ply(b"1", b"1 2\n"), "invalid column index 2 at row 1"),
        ("a.ply", ply(b"0"), "must hold points, got none of 0 rows"),
        ("a.ply", ply(b"1", b"nan 2 3"), "must hold points, got none of 1 rows"),
        ("a.ply", ply(b"99999999999", b"1 2 3"), "vertex must have 99999999999 lines"),
        ("a.ply", ply(b"2").replace(b"float z", b"float w"), "vertex lacks z"),
        (
            "a.ply", ply(b"2").replace(b"float x", b"list int int x"),
            "lists before x, y and z are not read",
        ),
        (
            "a.ply", ply(b"99999999999").replace(b"ascii", b"binary_big_endian"),
            "99999999999 of vertex need 1199999999988 bytes, got 0",
        ),
        ("a.ply", GOOD["open3d_binary.ply"][:-9], "20 of vertex need 1020 bytes"),
        ("a.ply", b"ply\nformat ascii 1.0\nend_header\n", "got no element vertex"),
        (
            "a.ply",
            GOOD["plyfile_big_endian.ply"].replace(b"vertex 20", b"lines 020"),
            "lists before or among the corners are not read",
        ),
        ("a.pcd", b"", "its header has no DATA"),
        ("a.pcd", b"\0" * 10**6, "its header has no DATA"),
        ("a.pcd", pcd(FIELDS="x y w"), "FIELDS must have z once"),
        ("a.pcd", pcd(FIELDS=None), "it lacks 'FIELDS'"),
        ("a.pcd", pcd(SIZE="4 4"), "must be of one length"),
        ("a.pcd", pcd(SIZE="4 4 3"), "no number is of type F and size 3"),
        ("a.pcd", pcd(COUNT="1 1 2"), "FIELDS must have z once"),
        ("a.pcd", pcd(COUNT="1 1 -2"), "COUNT must be of positive numbers"),
        ("a.pcd", pcd(WIDTH="0", POINTS="0"), "POINTS must be WIDTH times HEIGHT"),
        ("a.pcd", pcd(POINTS="3"), "POINTS must be WIDTH times HEIGHT"),
        ("a.pcd", pcd(WIDTH="two"), "invalid literal"),
        ("a.pcd", pcd(VIEWPOINT="0 0 0"), "VIEWPOINT must have seven numbers"),
        ("a.pcd", pcd("zip"), "DATA must be ascii, binary or binary_compressed"),
        ("a.pcd", pcd(body=b"1 2 3\n"), "is cut off: 2 points of it need 12 bytes"),
        ("a.pcd", pcd(body=b"1.25 2.25 3.25\n"), "must hold 2 points, got 1"),
        ("a.pcd", pcd(body=b"1 2 3\n4 5 a\n"), "could not convert string 'a'"),
        ("a.pcd", pcd(body=b"1 2 3\n4 5\n   "), "invalid column index 2 at row 2"),
        (
            "a.pcd",
            pcd("binary", WIDTH="100000", HEIGHT="100000", POINTS="10000000000"),
            "is cut off: 10000000000 points of it need 120000000000 bytes, got 0",
        ),
        ("a.pcd", pcd("binary", TWO.tobytes()[:-1]), "24 bytes, got 23"),
        ("a.pcd", pcd("binary_compressed"), "it must pack 24 bytes"),
        (
            "a.pcd",
            pcd("binary_compressed", struct.pack("<II", 5, 24) + b"12345"),
            "is not a readable PCD file",
        ),
        (
            "a.pcd",
            pcd(
                "binary_compressed", struct.pack("<II", 5, 1200000000) + b"12345",
                WIDTH="100000000", POINTS="100000000",
            ),
            "is cut off: 100000000 points of it need 1200000000 bytes, got 500",
        ),
        ("a.pcd", GOOD["pcl_compressed.pcd"][:400], "is cut off"),
        ("a.las", b"", "is not readable"),
        ("a.las", b"LASF", "is not readable"),
        ("a.las", GOOD["laspy.las"][:-40], "is cut off: it must hold 20 points"),
        ("a.las", GOOD["laspy.las"][:-60], "is cut off: it must hold 20 points"),
        ("a.las", las(_247=MOST), "it cannot hold the 1000000000000 points"),
        ("a.laz", GOOD["laspy.laz"][:-300], "is not readable"),
        ("a.xyz", b"", "must hold points, got none"),
        ("a.xyz", b"# nothing\n", "must hold points, got none"),
        ("a.xyz", b"\n" * 5000, "got 1000 lines without one"),
        ("a.xyz", b"1 2\n", "or a line that names x, y and z, got '1 2'"),
        ("a.csv", b"time,a,b\n1,2,3\n", "names x, y and z, got 'time,a,b'"),
        ("a.csv", b"1,2,3\n4,5,six\n", "could not convert string 'six'"),
        ("a.csv", b"1,2,3\n4,5\n", "invalid column index 2 at row 2"),
        ("a.asc", b"ncols 4\nnrows 4\n", "names x, y and z, got 'ncols 4'"),
        ("a.txt", b"\xff\xfe\0\1" * 100, "names x, y and z, got"),
        ("a.xyz", b"x y z\n", "must hold points, got none"),
        ("a.xyz", b"1 2 three\n", "names x, y and z, got '1 2 three'"),
        ("a.npy", b"", "is not a readable NPY file"),
        ("a.npy", npy(np.zeros(3))[:-1], "must hold 24 bytes of numbers, got 23"),
        ("a.npy", npy(np.zeros((2, 4))), r"got float64 of shape \(2, 4\)"),
        ("a.npy", npy(1.0), r"got float64 of shape \(\)"),
        ("a.npy", npy(np.zeros((2, 3), bool)), r"got bool of shape \(2, 3\)"),
        ("a.npy", npy(np.zeros((0, 3))), "must hold points, got none of 0 rows"),
        ("a.stl", b"", r"must end in one of \.ply, \.pcd, \.las, \.laz, \.npy, \.xyz"),
    ],
    ids=itertools.count(),
)  # fmt: skip
def test_a_file_that_holds_no_points_is_named(name, data, message, tmp_path, capfd):
    (tmp_path / name).write_bytes(data)
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=f"point file '.*{name}'.*{message}"):
            ij.io.read_points(tmp_path / name)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 50e6
    assert capfd.readouterr() == ("", "")


def test_what_is_no_file_is_named_as_what_it_is(tmp_path):
    with pytest.raises(ValueError, match=r"point file '.*a\.ply' does not exist"):
        ij.io.read_points(tmp_path / "a.ply")
    (tmp_path / "b.las").mkdir()
    with pytest.raises(ValueError, match="must be a file, got a folder"):
        ij.io.read_points(tmp_path / "b.las")


@pytest.mark.parametrize(
    ("name", "module"),
    [
        ("open3d_compressed.pcd", "lzf"),
        ("laspy.laz", "laspy"),
    ],
)
def test_missing_extra_is_named(name, module, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    need = r"needs \S*" + re.escape(module)
    with pytest.raises(ValueError, match=rf"{need}: .*'impostor-jax\[points\]'"):
        read(name)


def test_a_file_of_many_points_is_read_by_parts(monkeypatch):
    monkeypatch.setattr(points_file, "CHUNK", 7)
    np.testing.assert_allclose(read("laspy.laz").points - PLACE, POINTS, atol=5.1e-5)


def test_cloud_of_one_point_is_one():
    cloud = point_cloud.cloud_of([[1, 2, 3]], None, 1.0, "file")
    assert cloud.points.shape == (1, 3)
