"""Files that are none, or promise too much: one error each, soon, and no memory."""

import io
import json
import os
import struct
import time
import tracemalloc
import zlib

import cv2
import numpy as np
import pytest

from impostor_jax.io.camera_file import read_camera
from impostor_jax.io.depth_image import read_depth, read_mask
from impostor_jax.io.scene_file import read_scene

SETTINGS = {"fx": 60.0, "fy": 62.0, "cx": 31.5, "cy": 23.0, "width": 64, "height": 48}
READERS = {
    "camera file": lambda path: read_camera(path),
    "scene file": lambda path: read_scene(path),
    "depth image": lambda path: read_depth(path, 1e-4),
    "mask": lambda path: read_mask(path),
}


@pytest.fixture(autouse=True)
def bounded(capfd):
    """Each test takes less than a second and 50 MB, and prints nothing."""
    tracemalloc.start()
    start = time.perf_counter()
    yield
    seconds = time.perf_counter() - start
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # Tracing takes several times as long.
    assert seconds < 5
    assert most < 50e6
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("what", READERS)
@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("missing", "does not exist"),
        ("folder", "must be a file, got a folder"),
        ("pipe", "must be a file, got a pipe"),
        ("device", "must be a file, got a device"),
        ("loop", "cannot be read: Too many levels of symbolic links"),
        ("below a file", "does not exist"),
        ("long", "cannot be read: File name too long"),
    ],
)
def test_what_is_no_file_is_named_as_what_it_is(what, kind, message, tmp_path):
    suffix = ".json" if what.endswith("file") else ".png"
    path = tmp_path / f"given{suffix}"
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "loop":
        path.symlink_to(path)
    elif kind == "below a file":
        path.write_text("")
        path = path / f"given{suffix}"
    elif kind == "long":
        path = tmp_path / f"{'x' * 300}{suffix}"
    with pytest.raises(ValueError, match=f"{what} '.*{path.name}' {message}"):
        READERS[what](path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a":' * 50000 + "1" + "}" * 50000, "nested more than 100 deep"),
        ('{"fx": ' + "[" * 400 + "]" * 400 + "}", "nested more than 100 deep"),
        ("[" * 50000, "nested more than 100 deep"),
        ('{"fx": ' + "9" * 5000 + "}", "is not readable JSON"),
        ("", "is not readable JSON"),
        ("\0" * 100, "is not readable JSON"),
        (json.dumps(SETTINGS | {"depth_scale_m": True}), "depth_scale_m must be"),
        (json.dumps(SETTINGS | {"depth_scale_m": 1e300}), "depth_scale_m must be"),
        (json.dumps(SETTINGS | {"depth_scale_m": [1]}), "depth_scale_m must be"),
        (json.dumps(SETTINGS | {"fx": True}), "fx must be a positive number"),
        (json.dumps(SETTINGS | {"fx": 1e300}), "fx must be a positive number"),
        (json.dumps(SETTINGS | {"fx": 10**400}), "fx must be a positive number"),
        (json.dumps(SETTINGS | {"cx": "a"}), "cx must be a finite number"),
        (json.dumps(SETTINGS | {"cx": float("nan")}), "cx must be a finite number"),
        (json.dumps(SETTINGS | {"width": 10**12}), "at most 268435456 pixels together"),
        (
            json.dumps(SETTINGS | {"width": 64.0}),
            "width must be a whole number of at least 1 pixels",
        ),
        (json.dumps(SETTINGS | {"distortion": {"k1": 0}}), "distortion must"),
        (json.dumps(SETTINGS | {"distortion": [[1]]}), "distortion must"),
    ],
)  # fmt: skip
def test_bad_camera_is_named_with_its_file(tmp_path, text, message):
    (tmp_path / "camera.json").write_text(text)
    with pytest.raises(ValueError, match=f"camera file '.*camera.json'.*{message}"):
        read_camera(tmp_path / "camera.json")


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_json_may_begin_with_a_byte_order_mark(tmp_path, mark):
    path = tmp_path / "camera.json"
    path.write_bytes(mark + json.dumps(SETTINGS).encode())
    assert read_camera(path).camera.fx == 60.0


def test_bytes_that_are_no_text_are_refused(tmp_path):
    (tmp_path / "camera.json").write_bytes(b'{"fx": "\xff\xfe"}')
    with pytest.raises(ValueError, match="is not readable JSON"):
        read_camera(tmp_path / "camera.json")


def test_a_shape_that_is_broken_is_named_with_its_file(tmp_path):
    shape = {"type": "sphere", "center": [0, 0, 1], "radius": 1e30}
    (tmp_path / "scene.json").write_text(json.dumps({"version": 1, "shapes": [shape]}))
    message = (
        r"scene file '.*scene.json': shapes\[0\] \(sphere\): radius must be meters"
    )
    with pytest.raises(ValueError, match=message):
        read_scene(tmp_path / "scene.json")


def npy(shape, descr="<f4", data=b""):
    """An NPY file whose header says what one likes."""
    header = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}"
    size = struct.pack("<H", len(header))
    return b"\x93NUMPY\x01\x00" + size + header.encode() + data


def npz():
    file = io.BytesIO()
    np.savez(file, depth=np.ones((4, 4)))
    return file.getvalue()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (npy((400000, 400000)), "at most 268435456 pixels together"),
        (npy((4000, 4000)), "must hold 64000000 bytes of numbers, got 0"),
        (npy((4, 4), data=b"\0" * 63), "must hold 64 bytes of numbers, got 63"),
        (npy((4, 4), data=b"\0" * 65), "must hold 64 bytes of numbers, got 65"),
        (npy((0, 4)), "height must be a whole number of at least 1 pixels"),
        (
            npy((-4, -4)),
            "width must be a whole number of at least 1|is not a readable NPY file",
        ),
        (npy((4, 4, 4)), r"must have one channel, got shape \(4, 4, 4\)"),
        (npy((16,)), r"must have one channel, got shape \(16,\)"),
        (npy((4, 4), "<M8[s]"), "must hold integers or floats, got datetime64"),
        (npy((4, 4), "|V8"), "must hold integers or floats, got"),
        (npy((4, 4), "|b1"), "must hold integers or floats, got bool"),
        (npy((4, 4), "nonsense"), "is not a readable NPY file"),
        (npy("(" * 5000), "is not a readable NPY file"),
        (npz(), "is not a readable NPY file"),
        (b"", "is not a readable NPY file"),
        (b"\x93NUMPY\x09\x00", "is not a readable NPY file"),
    ],
)
def test_bad_npy_is_refused(tmp_path, data, message):
    (tmp_path / "depth.npy").write_bytes(data)
    with pytest.raises(ValueError, match=f"depth image '.*depth.npy'.*({message})"):
        read_depth(tmp_path / "depth.npy", None)


def test_arrays_in_any_order_are_read(tmp_path):
    depth = np.arange(12.0).reshape(3, 4)
    for values in (depth, np.asfortranarray(depth), depth.astype(">f4")):
        np.save(tmp_path / "depth.npy", values)
        np.testing.assert_array_equal(read_depth(tmp_path / "depth.npy", None), depth)


def chunk(name, data):
    sums = struct.pack(">I", zlib.crc32(name + data))
    return struct.pack(">I", len(data)) + name + data + sums


def png(height=4, width=4, bits=16, color=0, interlace=0, pixels=None, more=b""):
    """A PNG whose header says what one likes."""
    if pixels is None:
        pixels = (b"\0" + b"\1" * (width * bits // 8)) * height
    header = struct.pack(">IIBBBBB", width, height, bits, color, 0, 0, interlace)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + more
        + chunk(b"IDAT", zlib.compress(pixels)) + chunk(b"IEND", b"")
    )  # fmt: skip


GOOD = png()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (png(30000, 30000, pixels=b""), "at most 268435456 pixels together"),
        (png(2**31 - 1, 2**31 - 1, pixels=b""), "at most 268435456 pixels together"),
        (png(10000, 10000, pixels=b""), "its pixels are cut off or too many"),
        (png(pixels=b"\0" * 10**7), "its pixels are cut off or too many"),
        (png(0, 4, pixels=b""), "its header is broken"),
        (png(bits=3), "its header is broken"),
        (png(color=7), "its header is broken"),
        (png(interlace=2), "its header is broken"),
        (png(pixels=(b"\5" + b"\1" * 8) * 4), "its pixels are broken"),
        (png(color=2, pixels=b""), "must have one channel"),
        (png(bits=8, color=3, pixels=b""), "must have one channel"),
        (GOOD[:20], "its header is cut off"),
        (GOOD[:-5], "it is cut off"),
        (GOOD[:50], "it is cut off"),
        (GOOD[:45] + b"?" + GOOD[46:], "its pixels are broken"),
        (GOOD[:20] + b"?" + GOOD[21:], "its header is broken"),
        (GOOD[:33] + b"\xff" * 40, "it is cut off"),
        (b"\xff\xd8\xff\xe0" + b"\0" * 40, "must be a PNG or a TIFF, got a JPEG file"),
        (b"hello", "must be a PNG or a TIFF, got something else"),
        (b"", "must be a PNG or a TIFF, got something else"),
        (b"II*\0\xff\xff\xff\xff", "its header is cut off"),
        (b"II*\0\x08\0\0\0\xff\xff", "its header is cut off"),
        (b"II*\0\x08\0\0\0\0\0\0\0", "its header has no size"),
        (b"MM\0+\0\x08\0\0" + b"\xff" * 16, "its header is cut off"),
    ],
)
def test_bad_image_is_refused(tmp_path, data, message):
    (tmp_path / "given.png").write_bytes(data)
    for read in (READERS["depth image"], READERS["mask"]):
        with pytest.raises(ValueError, match=f"'.*given.png'.*{message}"):
            read(tmp_path / "given.png")


def test_a_file_much_larger_than_its_header_says_is_not_read(tmp_path):
    with (tmp_path / "given.png").open("wb") as file:
        file.write(GOOD)
        file.truncate(2**40)
    with pytest.raises(ValueError, match="has 1099511627776 bytes, and its header pro"):
        read_mask(tmp_path / "given.png")


def test_good_images_of_other_kinds_are_read(tmp_path):
    values = np.arange(70, dtype=np.uint16).reshape(7, 10) * 900
    expected = values * 1e-3
    path = tmp_path / "given.png"
    # A profile and a text, of which the library would print what it thinks.
    more = chunk(b"gAMA", b"\0") + chunk(b"iCCP", b"what\0\0") + chunk(b"tEXt", b"a")
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in values)
    path.write_bytes(png(7, 10, pixels=rows, more=more))
    np.testing.assert_allclose(read_depth(path, 1e-3), expected)
    path.write_bytes(interlaced(values))
    np.testing.assert_allclose(read_depth(path, 1e-3), expected)
    cv2.imwrite(str(tmp_path / "given.tiff"), values)
    np.testing.assert_allclose(read_depth(tmp_path / "given.tiff", 1e-3), expected)
    path.write_bytes(png(2, 8, bits=1, pixels=b"\0\xf0\0\x01"))
    np.testing.assert_array_equal(
        read_mask(path), np.unpackbits(np.array([[0xF0], [1]], np.uint8), axis=1) > 0
    )


def interlaced(values):
    starts = [(0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2),
              (0, 1, 2, 2), (1, 0, 2, 1)]  # fmt: skip
    pixels = b""
    for row, col, row_step, col_step in starts:
        part = values[row::row_step, col::col_step].astype(">u2")
        if part.size:
            pixels += b"".join(b"\0" + line.tobytes() for line in part)
    return png(*values.shape, interlace=1, pixels=pixels)


def test_size_is_checked_before_anything_is_decoded(tmp_path):
    (tmp_path / "given.png").write_bytes(png(9000, 9000, pixels=b""))
    (tmp_path / "given.npy").write_bytes(npy((9000, 9000)))
    for name in ("given.png", "given.npy"):
        with pytest.raises(
            ValueError,
            match=r"depth image must have the camera's shape \(48, 64\), got "
            rf"\(9000, 9000\) in '.*{name}'",
        ):
            read_depth(tmp_path / name, None, (48, 64))


def test_a_mask_of_floats_or_of_a_lossy_format_is_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "depth.tiff"), np.ones((4, 4), np.float32))
    with pytest.raises(
        ValueError, match=r"mask '.*depth.tiff' must hold integers, got"
    ):
        read_mask(tmp_path / "depth.tiff")
    cv2.imwrite(str(tmp_path / "mask.jpg"), np.full((4, 4), 255, np.uint8))
    with pytest.raises(ValueError, match=r"mask '.*mask.jpg' .* got a JPEG file"):
        read_mask(tmp_path / "mask.jpg")
