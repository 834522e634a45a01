"""Files in numpy's format that are none, by name, made from a good array; and good ones with random bytes."""

from __future__ import annotations

import io
import os
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
from icymoon.support.arrays import Array


def saved(array: Array) -> bytes:
    """An npy file."""
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def packed(members: Mapping[str, Array | bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """An npz file; members may be any bytes."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, each in members.items():
            archive.writestr(f"{name}.npy", each if isinstance(each, bytes) else saved(each))
    return stream.getvalue()


def header(shape: str, kind: str = "<f4") -> bytes:
    """The beginning of an npy file."""
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}\n".encode()
    return b"\x93NUMPY\1\0" + len(text).to_bytes(2, "little") + text


def damaged_npy(good: Array) -> dict[str, bytes]:
    """No npy files of numbers."""
    whole = saved(good)
    return {
        "empty": b"",
        "text": b"1 2 3\n",
        "magic": b"\x93NUMPY",
        "half": whole[: len(whole) // 2],
        "one less": whole[:-1],
        "one more": whole + b"\0",
        "zeros": bytes(len(whole)),
        "escapes": b"\x1b]0;x\7" * 50,
        "pickle": b"\x80\4N.",
        "stated huge": header("1000000000000,") + bytes(64),
        "300 digits": header("9" * 300 + ","),
        "5000 digits": header("9" * 5000 + ","),
        "negative": header("-3, -4") + bytes(48),
        "true": header("True,"),
        "wraps": header("4611686018427387904, 4"),
        "deep": header("(" * 4000),
        "text as shape": header("'x',"),
        "float as shape": header("3.0,") + bytes(12),
        "objects": header("1,", "|O") + bytes(8),
        "times": header("1,", "<M8[s]") + bytes(8),
        "texts": saved(np.array(["a", "b"])),
        "complex": saved(good.astype(np.complex64)),
        "record": saved(np.zeros(3, [("a", "f4")])),
        "version 9": b"\x93NUMPY\x09\0" + bytes(80),
        "long header": b"\x93NUMPY\2\0\xff\xff\xff\x7f" + bytes(80),
        "40 sides": header("1, " * 40) + bytes(4),
        "no dict": b"\x93NUMPY\1\0\x06\0[1, 2]",
    }


def damaged_npz(name: str, good: Array) -> dict[str, bytes | Callable[[], bytes]]:
    """No npz files with an array of numbers of this name, for ``Files``."""
    whole = packed({name: good})
    with warnings.catch_warnings(action="ignore"):  # of a name that is there twice
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w") as archive:
            for _ in range(2):
                archive.writestr(f"{name}.npy", saved(good))

    def patched(at: int, value: bytes) -> bytes:
        data = bytearray(whole)
        place = data.index(b"PK\1\2") + at
        data[place : place + len(value)] = value
        return bytes(data)

    return {
        **{f"member {kind}": packed({name: data}) for kind, data in damaged_npy(good).items()},
        "cut archive": whole[:-30],
        "marks": b"PK\3\4" * 99,
        "twice": stream.getvalue(),
        "bzip2": packed({name: good}, zipfile.ZIP_BZIP2),
        "lzma": packed({name: good}, zipfile.ZIP_LZMA),
        "odd compression": patched(10, b"\x63\0"),
        "encrypted": patched(8, b"\1\0"),
        "other size": patched(24, b"\5\0\0\0"),
        "huge size": patched(24, b"\xfe\xff\xff\xff"),
        "wrong sum": patched(16, b"\0\0\0\0"),
        "place beyond": patched(42, b"\xfe\xff\xff\x7f"),
        "many members": packed({str(k): b"" for k in range(1200)}),
        "bomb": lambda: packed({name: np.zeros(2**25)}),
    }


def flipped(whole: bytes, times: int, seed: int = 1) -> Iterator[bytes]:
    """A file with one to three random bytes, so many times."""
    random = np.random.default_rng(seed)
    for _ in range(times):
        data = bytearray(whole)
        for at in random.integers(0, len(data), random.integers(1, 4)):
            data[at] = random.integers(0, 256)
        yield bytes(data)


def put(path: Path, what: str | bytes) -> None:
    """In place of a file: these bytes, or a ``pipe``, a ``folder``, a link to a ``device``, or ``nothing``."""
    if path.is_dir() and not path.is_symlink():
        path.rmdir()
    path.unlink(missing_ok=True)
    if isinstance(what, bytes):
        path.write_bytes(what)
    elif what == "pipe":
        os.mkfifo(path)
    elif what == "folder":
        path.mkdir()
    elif what == "device":
        path.symlink_to("/dev/zero")


#: What ``put`` puts besides bytes.
NO_FILES = ("pipe", "folder", "device", "nothing")
