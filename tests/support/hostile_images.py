"""Image files that a stranger may have made: small ones that state much, unfold without end, or are torn."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from functools import partial

import cv2
import numpy as np
from files_when_asked import Files
from icymoon.support.arrays import Array

WIDTH, HEIGHT = 24, 16


def chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png(
    width: int = WIDTH,
    height: int = HEIGHT,
    depth: int = 8,
    colour: int = 0,
    between: bytes = b"",
    data: bytes | None = None,
    interlaced: int = 0,
) -> bytes:
    """A PNG with grey rows, or whatever ``data`` unfolds to, and chunks ``between`` its size and its pixels."""
    rows = data if data is not None else bytes(min(height, 100) * (1 + min(width, 1000)))
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, interlaced))
        + between
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


def texture(bands: int = 1) -> Array:
    noise = np.random.default_rng(3).integers(0, 256, (HEIGHT, WIDTH, bands)).astype(np.uint8)
    return noise[..., 0] if bands == 1 else noise


def encode(kind: str, image: Array, *parameters: int) -> bytes:
    done, content = cv2.imencode(kind, image, parameters)
    assert done
    return content.tobytes()


def segment(kind: int, body: bytes) -> bytes:
    return bytes([0xFF, kind]) + struct.pack(">H", len(body) + 2) + body


def frame(width: int, height: int, bands: int = 1, depth: int = 8, kind: int = 0xC0) -> bytes:
    return segment(
        kind,
        struct.pack(">BHHB", depth, height, width, bands) + b"".join(bytes((k, 0x11, 0)) for k in range(1, bands + 1)),
    )


def with_frame(jpeg: bytes, other: bytes, instead: bool = True) -> bytes:
    """A JPEG with another frame header in place of its own, or before it."""
    at = next(k for k in range(2, len(jpeg)) if jpeg[k] == 0xFF and jpeg[k + 1] in (0xC0, 0xC2))
    end = at + 2 + int.from_bytes(jpeg[at + 2 : at + 4], "big")
    return jpeg[:at] + other + jpeg[end if instead else at :]


def riff(*parts: tuple[bytes, bytes]) -> bytes:
    body = b"WEBP" + b"".join(
        struct.pack("<4sI", kind, len(data)) + data + b"\0" * (len(data) & 1) for kind, data in parts
    )
    return b"RIFF" + struct.pack("<I", len(body)) + body


def vp8x(width: int, height: int, flags: int = 0) -> tuple[bytes, bytes]:
    return b"VP8X", struct.pack("<I", flags) + (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little")


def attribute(name: bytes, kind: bytes, value: bytes, size: int | None = None) -> bytes:
    return name + b"\0" + kind + b"\0" + struct.pack("<i", len(value) if size is None else size) + value


def exr(
    window: tuple[int, int, int, int] = (0, 0, WIDTH - 1, HEIGHT - 1),
    channels: int = 1,
    flags: int = 0,
    more: bytes = b"",
    rest: bytes = b"",
    kind: int = 2,
    sampling: int = 1,
    names: str = "Z{k}",
) -> bytes:
    """The header of an EXR file of lines, and a table of chunks in which each is at its end."""
    listed = (
        b"".join(
            names.format(k=k).encode() + b"\0" + struct.pack("<iB3xii", kind, 0, sampling, sampling)
            for k in range(channels)
        )
        + b"\0"
    )
    head = b"".join(
        (
            attribute(b"channels", b"chlist", listed),
            attribute(b"compression", b"compression", b"\3"),
            attribute(b"dataWindow", b"box2i", struct.pack("<4i", *window)),
            attribute(b"displayWindow", b"box2i", struct.pack("<4i", *window)),
            attribute(b"lineOrder", b"lineOrder", b"\0"),
            attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1)),
            attribute(b"screenWindowCenter", b"v2f", bytes(8)),
            attribute(b"screenWindowWidth", b"float", bytes(4)),
            more,
        )
    )
    start = b"\x76\x2f\x31\x01" + struct.pack("<I", 2 | flags) + head + b"\0"
    return start + rest


def npz(**arrays: Array) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def zipped(*members: tuple[str, bytes], kind: int = zipfile.ZIP_DEFLATED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", kind) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return stream.getvalue()


def npy(shape: str, kind: str = "<f4", body: bytes = b"") -> bytes:
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\0" + struct.pack("<H", len(head)) + head + body


def tiff(*tags: tuple[int, int, int, int], order: str = "<", rest: bytes = b"") -> bytes:
    mark = b"II*\0" if order == "<" else b"MM\0*"
    return (
        mark
        + struct.pack(f"{order}I", 8)
        + struct.pack(f"{order}H", len(tags))
        + b"".join(struct.pack(f"{order}HHII", *tag) for tag in tags)
        + bytes(4)
        + rest
    )


_JPEG, _COLOURED = encode(".jpg", texture()), encode(".jpg", texture(3))
_PROGRESSIVE = encode(".jpg", texture(3), cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
_SCAN = _JPEG.index(b"\xff\xda")
_SIZE = (256, 3, 1, WIDTH), (257, 3, 1, HEIGHT)

#: What no reader may take. All are small, and none may cost much memory or time.
PNGS = {
    "2^31": png(2**31, 2**31),
    "2^31 wide": png(2**31 - 1, 1),
    "30000 x 20000": png(30000, 20000),
    "no width": png(0, 5),
    "no height": png(5, 0),
    "one pixel too many": png(8193, 8192),
    "depth 3": png(depth=3),
    "colour 5": png(colour=5),
    "16 bits in a palette": png(depth=16, colour=3),
    "a palette that is missing": png(colour=3),
    "too few rows": png(data=bytes(30)),
    "no rows": png(data=b""),
    "interlaced as none is": png(interlaced=9),
    "two sizes": png(between=chunk(b"IHDR", struct.pack(">IIBBBBB", 2**30, 4, 8, 0, 0, 0, 0))),
    "an unknown part": png(between=chunk(b"CgBI", bytes(4))),
    "a palette of 1 MB": png(colour=3, between=chunk(b"PLTE", bytes(3 * 2**18))),
    "a negative length": png()[:33] + b"\xff" * 4 + b"IDAT" + png()[33:],
    "a wrong checksum": png()[:-20] + b"\0" + png()[-19:],
    "no end": png()[:-12],
    "cut": png()[:45],
    "a mark": png()[:8],
    "another size of its header": png()[:8] + chunk(b"IHDR", bytes(14)),
    "a data stream of another kind": png()[:33] + chunk(b"IDAT", b"no data") + chunk(b"IEND", b""),
    "200,001 parts": png(between=chunk(b"tEXt", b"") * 200_001),
}
JPEGS = {
    "few bytes for its size": with_frame(_JPEG, frame(8000, 8000)),
    "65535 x 65535": with_frame(_JPEG, frame(65535, 65535)),
    "no height": with_frame(_JPEG, frame(9, 0)),
    "no width": with_frame(_JPEG, frame(0, 9)),
    "two sizes": with_frame(_JPEG, frame(WIDTH, HEIGHT), False),
    "12 bits": with_frame(_JPEG, frame(WIDTH, HEIGHT, depth=12)),
    "16 bits": with_frame(_JPEG, frame(WIDTH, HEIGHT, 1, 16)),
    "without loss": with_frame(_JPEG, frame(WIDTH, HEIGHT, kind=0xC3)),
    "a frame of nothing": with_frame(_JPEG, segment(0xC0, b"")),
    "no frame": with_frame(_JPEG, b""),
    "no scan": _JPEG[:_SCAN] + b"\xff\xd9",
    "cut": _JPEG[:-2],
    "cut in its pixels": _JPEG[: _SCAN + 20],
    "cut in a restart": _JPEG[:-2] + b"\xff\xd0",
    "cut after a stuffed byte": _JPEG[:-2] + b"\xff\0",
    "cut within a mark": _JPEG[:-1],
    "a mark": _JPEG[:3],
    "a segment of no length": b"\xff\xd8\xff\xe0\0\1" + _JPEG[2:],
    "fill without end": b"\xff\xd8" + b"\xff" * 100_000,
    "segments without end": b"\xff\xd8" + segment(0xFE, b"") * 100_000 + b"\xff\xd9",
    "restarts without end": b"\xff\xd8" + b"\xff\xd0" * 100_000,
    "an image in it": _JPEG[:_SCAN] + _JPEG,
    "a mark of the end before": b"\xff\xd8\xff\xd9" + _JPEG[2:],
    "more scans than there are": _PROGRESSIVE[:-2] + segment(0xDA, b"\1\1\0\0\0\0") * 101 + b"\xff\xd9",
    "a film": b"\xff\xd8\xff" + bytes(2000),
    "stuffed bytes": _JPEG[:_SCAN] + segment(0xDA, b"\1\1\0\0\x3f\0") + b"\xff\0" * 10**6,
}
WEBPS = {
    "2^24 wide": riff(vp8x(2**24, 2**24), (b"VP8L", b"\x2f" + bytes(4))),
    "two sizes": riff(vp8x(5, 5), (b"VP8L", b"\x2f" + struct.pack("<I", 9 | 9 << 14))),
    "16384 wide": riff((b"VP8L", b"\x2f" + b"\xff" * 4 + bytes(50))),
    "no size": riff((b"EXIF", b"abcd")),
    "nothing": riff(),
    "an animation": riff(vp8x(5, 5, 2), (b"ANIM", bytes(6)), (b"ANMF", bytes(30))),
    "no width": riff((b"VP8 ", b"\x10\0\0\x9d\x01\x2a" + bytes(4))),
    "another mark": riff((b"VP8 ", bytes(30))),
    "another mark of VP8L": riff((b"VP8L", bytes(30))),
    "a short part": riff((b"VP8X", b"")),
    "cut": encode(".webp", texture(3))[:-9],
    "a mark": encode(".webp", texture(3))[:12],
    "a size that is larger": b"RIFF\xff\xff\xff\xffWEBP" + encode(".webp", texture(3))[12:],
    "a part that is larger": riff((b"VP8 ", b""))[:-4] + b"\xff" * 4,
    "no pixels": riff((b"VP8L", b"\x2f" + bytes(4))),
    "parts without end": riff(*[(b"EXIF", b"")] * 10_001),
    "pixels of nothing": riff((b"VP8 ", b"\x10\0\0\x9d\x01\x2a" + struct.pack("<HH", WIDTH, HEIGHT))),
    "a canvas and no image": riff(vp8x(WIDTH, HEIGHT)),
    "opacity alone": riff(vp8x(5, 5, 16), (b"ALPH", bytes(99))),
    "an odd end": riff((b"VP8L", b"\x2f" + bytes(5)))[:-1],
}
EXRS = {
    "65536 wide": exr((0, 0, 65535, 65535)),
    "2^32 wide": exr((-(2**31), -(2**31), 2**31 - 1, 2**31 - 1)),
    "no width": exr((0, 0, -1, 5)),
    "backwards": exr((9, 9, 0, 0)),
    "1000 large channels": exr((0, 0, 999, 999), 1000),
    "1000 channels": exr(channels=1000, names="c{k}"),
    "deep": exr(flags=0x800),
    "several and deep": exr(flags=0x1800),
    "deep by its type": exr(more=attribute(b"type", b"string", b"deepscanline")),
    "no channels": exr(channels=0),
    "a channel twice": exr(channels=2, names="Z"),
    "a channel of another kind": exr(kind=7),
    "of a negative": exr(kind=-1),
    "no sampling": exr(sampling=0),
    "a negative sampling": exr(sampling=-1),
    "sampled": exr(sampling=2),
    "a negative size": exr(more=attribute(b"a", b"b", b"", -40)),
    "a huge size": exr(more=attribute(b"a", b"b", b"", 2**31 - 1)),
    "two windows": exr(more=attribute(b"dataWindow", b"box2i", bytes(16))),
    "a name without end": exr()[:8] + b"a" * 9999,
    "attributes without end": exr(more=attribute(b"a", b"b", b"") * 20_000),
    "many attributes": exr(more=b"".join(attribute(b"%d" % k, b"b", b"") for k in range(10_001))),
    "cut": exr()[:60],
    "a mark": exr()[:4],
    "no chunks": exr(),
    "chunks at its end": exr(rest=struct.pack("<Q", 2**40) * HEIGHT),
    "chunks at one place": exr((0, 0, 3999, 3999), rest=struct.pack("<Q", 400) * 250 + bytes(4000)),
    "tiles of 2^31": exr(
        flags=0x200, more=attribute(b"tiles", b"tiledesc", struct.pack("<IIB", 2**31 - 1, 2**31 - 1, 0))
    ),
    "tiles of nothing": exr(flags=0x200, more=attribute(b"tiles", b"tiledesc", bytes(9))),
    "parts without end": exr(flags=0x1000) + exr()[8:] * 1001,
    "no window": exr().replace(b"dataWindow", b"dataWindox"),
    "2^31 chunks": exr(flags=0x1000, more=attribute(b"chunkCount", b"int", struct.pack("<i", 2**31 - 1)), rest=b"\0"),
}
PFMS = {
    "large": b"Pf\n999999 999999\n-1\n",
    "2^31": b"Pf\n2147483648 1\n-1\n",
    "digits": b"Pf\n" + b"9" * 5000 + b" 4\n-1\n",
    "20 digits": b"Pf\n" + b"9" * 20 + b" 4\n-1\n",
    "negative": b"Pf\n-4 -1\n-1\n" + bytes(16),
    "zero": b"Pf\n0 4\n-1\n",
    "a fraction": b"Pf\n1.5 4\n-1\n" + bytes(24),
    "no scale": b"Pf\n2 2\n",
    "a scale of text": b"Pf\n2 2\nx\n" + bytes(16),
    "a scale that is none": b"Pf\n2 2\nnan\n" + bytes(16),
    "an infinite scale": b"Pf\n2 2\n-1e999\n" + bytes(16),
    "one byte less": b"Pf\n2 2\n-1\n" + bytes(15),
    "one byte more": b"Pf\n2 2\n-1\n" + bytes(17),
    "twice": b"Pf\n2 2\n-1\n" + bytes(32),
    "colours": b"PF\n2 2\n-1\n" + bytes(48),
    "a comment without end": b"Pf\n#" + b"a" * 10**6,
    "blanks without end": b"Pf\n" + b" " * 10**6,
    "comments without end": b"Pf\n" + b"#\n" * 10**6,
    "a mark": b"Pf",
    "one byte less of Windows'": b"Pf\r\n2 2\r\n-1\r\n" + bytes(15),
    "two ways": b"Pf\n2 2\n-1\r\n" + bytes(15) + b"\n",
    "a text": b"Pfennig for your thoughts",
    "joined": b"Pf2 2 -1\n" + bytes(16),
    "escapes": b"Pf\n\x1b[2J 2\n-1\n",
}
ARRAYS = {
    "huge": npy("(1000000000000, 3)"),
    "digits": npy("(%s,)" % ("9" * 300)),
    "negative": npy("(-2, -2)", body=bytes(16)),
    "objects": npy("(1, 1)", "|O", bytes(8)),
    "texts": npy("(1, 1)", "<U2", bytes(8)),
    "times": npy("(1, 1)", "<M8[s]", bytes(8)),
    "complex": npy("(1, 1)", "<c8", bytes(8)),
    "truths": npy("(1, 1)", "|b1", bytes(1)),
    "empty": npy("(0, 5)"),
    "no axes": npy("()", body=bytes(4)),
    "three axes": npy("(2, 2, 2)", body=bytes(32)),
    "many axes": npy("(%s)" % ("1," * 33), body=bytes(4)),
    "structured": npy("(1, 1)", "[('a', '<f4')]", bytes(4)),
    "one byte less": npy("(2, 2)", body=bytes(15)),
    "one byte more": npy("(2, 2)", body=bytes(17)),
    "a mark": b"\x93NUMPY",
    "version 9": b"\x93NUMPY\x09\0" + bytes(40),
    "a header of 4 GB": b"\x93NUMPY\x02\0\xff\xff\xff\xff",
    "nested": b"\x93NUMPY\x02\0" + struct.pack("<I", 9000) + b"(" * 9000,
    "a pixel too many": npy("(8193, 8193)", "|u1"),
}
ARCHIVES = Files(
    {
        "a bomb": lambda: npz(disparity=np.zeros((9000, 9000))),
        "two arrays": npz(a=np.zeros((2, 2)), b=np.zeros((2, 2))),
        "a huge shape": zipped(("disparity.npy", ARRAYS["huge"])),
        "no array": zipped(("disparity.npy", b"")),
        "a text": zipped(("disparity.npy", b"hello")),
        "nothing": zipped(),
        "bzip2": zipped(("disparity.npy", npy("(1, 1)", body=bytes(4))), kind=zipfile.ZIP_BZIP2),
        "lzma": zipped(("disparity.npy", npy("(1, 1)", body=bytes(4))), kind=zipfile.ZIP_LZMA),
        "objects": zipped(("disparity.npy", ARRAYS["objects"])),
        "texts": npz(a=np.array([["b"]])),
        "a mark": b"PK\x03\x04",
        "members": zipped(*((f"{k}.npy", b"") for k in range(1001))),
        "cut": npz(a=np.eye(9))[:-30],
        "three axes": npz(a=np.ones((2, 2, 2))),
        "no numbers": npz(a=np.zeros((0, 3))),
        "an escape": zipped(("\x1b[2J.npy", b"1"), ("b", b"2")),
    }
)
TIFFS = {
    "65536 wide": tiff((256, 4, 1, 65536), (257, 4, 1, 65536)),
    "2^32 wide": tiff((256, 4, 1, 2**32 - 1), (257, 4, 1, 2**32 - 1)),
    "no width": tiff((256, 4, 1, 0), (257, 4, 1, 4)),
    "no size": tiff((258, 3, 1, 8)),
    "no tags": tiff(),
    "a mark": b"II*\0",
    "no strips": tiff(*_SIZE),
    "a palette": tiff(*_SIZE, (262, 3, 1, 3), (273, 4, 1, 8), (279, 4, 1, 9)),
    "a circle": b"II*\0" + struct.pack("<IHI", 8, 0, 8),
    "a place beyond": b"II*\0" + struct.pack("<I", 2**31),
    "a strip beyond": tiff(*_SIZE, (258, 3, 1, 8), (273, 4, 1, 2**31), (279, 4, 1, 384)),
    "of JPEG": tiff(*_SIZE, (259, 3, 1, 7), (273, 4, 1, 8), (279, 4, 1, 9)),
    "17 bits": tiff(*_SIZE, (258, 3, 1, 17)),
    "strips of nothing": tiff(*_SIZE, (278, 3, 1, 0), (273, 4, 1, 8), (279, 4, 1, 9)),
    "65535 bands": tiff(*_SIZE, (277, 3, 1, 65535)),
    "values beyond": tiff((256, 4, 2**30, 0), (257, 4, 1, 5)),
    "big": b"II+\0" + bytes(20),
    "of Motorola": tiff((256, 4, 1, 65536), (257, 4, 1, 65536), order=">"),
    "deflated": tiff(*_SIZE, (258, 3, 1, 8), (259, 3, 1, 8), (273, 4, 1, 8), (279, 4, 1, 99)),
    "size as text": tiff((256, 2, 4, 0), *_SIZE[1:]),
}
OTHERS = {
    "nothing": b"",
    "zeros": bytes(64),
    "GIF": b"GIF89a" + bytes(60),
    "BMP": b"BM" + bytes(60),
    "text": b"hello\n" * 9,
    "escapes": b"\x1b]0;a\7" * 9,
    "a page": b"<svg xmlns='http://www.w3.org/2000/svg'/>",
}
IMAGES = Files(
    {
        f"{kind}: {name}": partial(those.__getitem__, name)
        for kind, those in (("png", PNGS), ("jpg", JPEGS), ("webp", WEBPS), ("tif", TIFFS), ("x", OTHERS))
        for name in those
    }
)
MAPS = Files(
    {
        f"{kind}: {name}": partial(those.__getitem__, name)
        for kind, those in (
            ("png", PNGS),
            ("exr", EXRS),
            ("pfm", PFMS),
            ("npy", ARRAYS),
            ("npz", ARCHIVES),
            ("tif", TIFFS),
            ("x", OTHERS),
        )
        for name in those
    }
)


def unfolding() -> bytes:
    """A PNG with a text and a profile of a hundred million zeros each."""
    black = zlib.compress(bytes(10**8))
    return png(between=chunk(b"zTXt", b"a\0\0" + black) + chunk(b"iCCP", b"a\0\0" + black))


#: What is right, although it has much that a reader need not read.
WHOLE = Files(
    {
        "png: texts and profiles that unfold": unfolding,
        "png: an animation": png(between=chunk(b"acTL", struct.pack(">II", 2**30, 0)) + chunk(b"fcTL", bytes(26))),
        "png: pixels that go on": png(data=bytes(HEIGHT * (WIDTH + 1)) + bytes(10**7)),
        "png: more behind": png() + bytes(500),
        "jpg: more behind": _JPEG + bytes(5000),
        "jpg: marks behind": _JPEG + b"\xff\xd8\xff\xda" * 99,
        "jpg: fill": b"\xff\xd8\xff" + _JPEG[2:],
        "jpg: progressive": _PROGRESSIVE,
        "jpg: colour": _COLOURED,
        "jpg: restarts": encode(".jpg", texture(3), cv2.IMWRITE_JPEG_RST_INTERVAL, 1),
        "webp: colour": encode(".webp", texture(3)),
        "webp: opacity": encode(".webp", texture(4)),
        "webp: without loss": encode(".webp", texture(3), cv2.IMWRITE_WEBP_QUALITY, 101),
        "webp: more behind": encode(".webp", texture(3)) + bytes(99),
        "tif: 16 bits": encode(".tif", texture().astype(np.uint16) * 257),
    }
)
