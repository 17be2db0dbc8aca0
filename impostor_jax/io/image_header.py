"""What the header of an image file says, before anything is decoded.

A header of a few bytes may promise gigabytes, so size and channels are checked first.
A PNG is also taken apart and put together again from what pixels need, with its sums
checked: its library prints what it finds wrong past every handler.

References:
    ISO/IEC 15948 (PNG); TIFF, revision 6.0, and BigTIFF.
"""

__all__ = ["PNG", "TIFF", "ImageHeader", "plain_png", "read_header"]

import io
import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

PNG, TIFF = "PNG", "TIFF"
OTHERS = {b"\xff\xd8\xff": "JPEG", b"RIFF": "WebP", b"GIF8": "GIF", b"BM": "BMP"}
"""First bytes of formats that are named to the user, but not read."""

SIGNATURE = b"\x89PNG\r\n\x1a\n"
CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
"""Of the color types of a PNG; a palette, 3, is of three."""

PASSES = (
    (0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2),
    (1, 0, 2, 1),
)  # fmt: skip
"""First row and column and the steps of the passes of an interlaced PNG."""

MAX_TAGS = 4096
"""Most fields of a TIFF that are looked at."""


class ImageHeader(NamedTuple):
    """What a header says.

    Attributes:
        format: `PNG`, `TIFF`, another name, or "" where it is not known; the rest is 0
            of all but the first two.
        height: Number of rows.
        width: Number of columns.
        channels: Numbers a pixel.
        bits: Of each.
        is_interlaced: Whether a PNG is.
    """

    format: str
    height: int = 0
    width: int = 0
    channels: int = 0
    bits: int = 0
    is_interlaced: bool = False

    @property
    def num_bytes(self) -> int:
        """Of the pixels, in a file that is not compressed."""
        return sum(rows * (stride + 1) for rows, stride in self.rows())

    def rows(self) -> Iterator[tuple[int, int]]:
        """Of each pass: number of rows, and bytes of one."""
        passes = PASSES if self.is_interlaced else ((0, 0, 1, 1),)
        for row, col, row_step, col_step in passes:
            rows = len(range(row, self.height, row_step))
            cols = len(range(col, self.width, col_step))
            if rows and cols:
                yield rows, (cols * self.channels * self.bits + 7) // 8


def read_header(file: io.BufferedIOBase) -> ImageHeader:
    """Read the header of a file that is open at its beginning.

    Raises:
        ValueError: It is broken.
    """
    begin = file.read(33)
    if begin.startswith(SIGNATURE):
        return _png_header(begin)
    if begin[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        try:
            return _tiff_header(file, begin)
        except (struct.error, OverflowError, OSError) as error:
            raise ValueError("its header is cut off") from error
    names = (name for start, name in OTHERS.items() if begin.startswith(start))
    return ImageHeader(next(names, ""))


def _png_header(begin: bytes) -> ImageHeader:
    if len(begin) < 33 or begin[8:16] != b"\0\0\0\rIHDR":
        raise ValueError("its header is cut off")
    if zlib.crc32(begin[12:29]) != int.from_bytes(begin[29:33], "big"):
        raise ValueError("its header is broken")
    width, height, bits, color, packing, filtering, interlace = struct.unpack(
        ">IIBBBBB", begin[16:29]
    )
    is_known = color in CHANNELS and bits in (1, 2, 4, 8, 16) and interlace < 2
    if not is_known or packing or filtering or not width or not height:
        raise ValueError("its header is broken")
    return ImageHeader(PNG, height, width, CHANNELS[color], bits, interlace == 1)


def _tiff_header(file: io.BufferedIOBase, begin: bytes) -> ImageHeader:
    order = "<" if begin[:1] == b"I" else ">"
    is_big = b"+" in begin[:4]
    (offset,) = struct.unpack_from(f"{order}{'Q' if is_big else 'I'}", begin,
                                   8 if is_big else 4)  # fmt: skip
    count_form, tag_form = ("Q", "HHQ8s") if is_big else ("H", "HHI4s")
    if offset >= 2**62:
        raise ValueError("its header is cut off")
    file.seek(offset)
    size = struct.calcsize(order + count_form)
    (count,) = struct.unpack(order + count_form, file.read(size))
    size = struct.calcsize(order + tag_form)
    found = {}
    for _ in range(min(count, MAX_TAGS)):
        tag, kind, number, value = struct.unpack(order + tag_form, file.read(size))
        form = {1: "B", 3: "H", 4: "I", 16: "Q"}.get(kind)
        # Several numbers are elsewhere; those that count here are single ones.
        if form is not None and number == 1:
            (found[tag],) = struct.unpack_from(order + form, value)
    width, height = found.get(256, 0), found.get(257, 0)
    if not width or not height:
        raise ValueError("its header has no size")
    channels = found.get(277, 1)
    return ImageHeader(TIFF, height, width, channels, found.get(258, 1))


def plain_png(data: bytes, header: ImageHeader) -> bytes:
    """The same gray image as a PNG of nothing else, with its sums checked.

    Raises:
        ValueError: It is cut off, or broken.
    """
    pixels = zlib.decompressobj()
    packed = b"".join(_pixel_chunks(data))
    try:
        # No more than there may be: a few bytes can hold a thousand times as many.
        raw = pixels.decompress(packed, header.num_bytes + 1)
    except zlib.error as error:
        raise ValueError("its pixels are broken") from error
    if len(raw) != header.num_bytes or not pixels.eof:
        raise ValueError("its pixels are cut off or too many")
    start = 0
    for rows, stride in header.rows():
        end = start + rows * (stride + 1)
        filters = np.frombuffer(raw[start:end], np.uint8)[:: stride + 1]
        if filters.max() > 4:
            raise ValueError("its pixels are broken")
        start = end
    # Stored without packing, so that no time is spent on unpacking it once more.
    stored = zlib.compress(raw, 0)
    return data[:33] + _chunk(b"IDAT", stored) + _chunk(b"IEND", b"")


def _pixel_chunks(data: bytes) -> Iterator[bytes]:
    """Contents of the chunks of pixels."""
    start = 33
    while True:
        size = int.from_bytes(data[start : start + 4], "big")
        name = data[start + 4 : start + 8]
        end = start + 8 + size
        if end + 4 > len(data):
            raise ValueError("it is cut off")
        if name == b"IEND":
            return
        if name == b"IDAT":
            sum_read = int.from_bytes(data[end : end + 4], "big")
            if zlib.crc32(data[start + 4 : end]) != sum_read:
                raise ValueError("its pixels are broken")
            yield data[start + 8 : end]
        start = end + 4


def _chunk(name: bytes, data: bytes) -> bytes:
    return (
        struct.pack(">I", len(data))
        + name
        + data
        + struct.pack(">I", zlib.crc32(name + data))
    )
