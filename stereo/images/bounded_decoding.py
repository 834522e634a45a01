"""Decoding images of others where memory and time are bounded.

OpenCV and OpenEXR have had errors in their use of memory, and there are files of a few kB that keep them busy for
minutes. So they decode images of others in another process, which is started for the first such image and stays: a
line of JSON and a file come in, a line of JSON and the pixels go out. It may take memory and time in proportion to the
stated size. When it crashes or takes longer, it is ended and the next image gets a new one. It ends when its input
ends, which happens however this process ends.

Pixels of another size than this process found in the file's header are refused.
"""

from __future__ import annotations

import atexit
import json
import math
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np

from ...support import system
from ...support.arrays import Array
from ...support.foreign_bytes import RefusedError, parse_json
from .exr_header import Channel
from .image_headers import EncodedImage

#: The largest image takes 4 s, and a machine may be busy with much else.
_LIMIT_S = 60.0
#: Processor time of a decoder: time to load the libraries, and ten times the time of the slowest kind, 100 MB/s.
_CPU_S, _CPU_S_PER_BYTE = 2.0, 1e-7
#: Its memory: the pixels, the decoder's copies of them (progressive JPEG has coefficients of two bytes), the file.
_COPIES, _MEMORY = 3, 2**26
_LOOK_S, _LONGEST_LINE = 0.25, 10_000
_TYPES = ("u1", "u2", "u4", "i1", "i2", "i4", "f2", "f4", "f8")
#: A second thread would take address space, and time that is counted.
_ENVIRONMENT = {"MALLOC_ARENA_MAX": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def decode(image: EncodedImage) -> Array:
    """The pixels of an image, (H, W) or (H, W, 3 or 4), as OpenCV gives them.

    Raises ValueError if it is damaged, RefusedError if it cannot be decoded within the bounds.
    """
    pixels = _ask_decoder({}, image.content, image.most_bytes)
    if pixels.shape[:2] != (image.height, image.width):
        raise ValueError(f"its size is not {image.width} x {image.height} px")
    return pixels


def decode_exr(path: Path, channel: Channel, all_bytes: int) -> Array:
    """The pixels of one channel of an EXR file, whose channels have ``all_bytes``. Raises as ``decode`` does."""
    request = {"path": str(path), "part": channel.part, "channel": channel.name}
    pixels = _ask_decoder(request, b"", all_bytes)
    if pixels.shape != (channel.height, channel.width) or pixels.dtype != channel.dtype:
        raise ValueError(f"its size is not {channel.width} x {channel.height} px")
    return pixels


class _DecoderDiedError(Exception):
    """The decoder has ended."""


class _Decoder:
    """A running decoder."""

    def __init__(self) -> None:
        from ...render.workers.job_commands import python_command

        self.owner = os.getpid()
        try:
            self._process = system.start(
                python_command(sys.executable, "decode"),
                {**os.environ, **system.KEEPS_MEMORY, **_ENVIRONMENT},  # the same Python finds the same packages
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
        except OSError as error:
            raise RefusedError(
                f"needs a process to be decoded, which cannot be started "
                f"({error.strerror or error}); end other programs."
            ) from None

    def ask(self, request: Mapping[str, Any], content: bytes, most_bytes: int) -> Array | str:
        """The pixels, or the error in words. Raises _DiedError if it has ended, TimeoutError if it takes too long."""
        answer: queue.SimpleQueue[Array | str | None] = queue.SimpleQueue()
        # A thread, since Windows has no pipe that can be waited for with a limit.
        threading.Thread(target=self._exchange, args=(request, content, most_bytes, answer), daemon=True).start()
        end = time.monotonic() + _LIMIT_S
        while time.monotonic() < end:
            with suppress(queue.Empty):  # in short steps, as Windows interrupts nobody who waits
                found = answer.get(timeout=_LOOK_S)
                if found is None:
                    raise _DecoderDiedError
                return found
        raise TimeoutError

    def _exchange(
        self,
        request: Mapping[str, Any],
        content: bytes,
        most_bytes: int,
        answer: queue.SimpleQueue[Array | str | None],
    ) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps(request).encode("ascii") + b"\n")
            self._process.stdin.write(content)
            self._process.stdin.flush()
            answer.put(_read_answer(self._process.stdout, most_bytes))
        except Exception:  # whatever it answered instead, nothing more is expected of it
            answer.put(None)

    def end(self) -> int | None:
        """End it; the exit status that it had before, None if it was running."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_LOOK_S)
        status = self._process.poll()
        system.kill_all(self._process)
        self.close()
        return status

    def close(self) -> None:
        """Close our ends of its pipes, which a process that was forked from its owner has too."""
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            with suppress(OSError):  # input that it has not read
                stream.close()


def _read_answer(stream: IO[bytes], most_bytes: int) -> Array | str:
    """The pixels, or the error in words. Raises ValueError for any other answer."""
    line = stream.readline(_LONGEST_LINE)
    if not line.endswith(b"\n"):
        raise ValueError("it has ended")
    answer = parse_json(line)
    if "error" in answer:
        return str(answer["error"])[:200]
    shape, dtype = answer["shape"], np.dtype(answer["type"])
    if (
        dtype.str[1:] not in _TYPES
        or not all(type(each) is int and each > 0 for each in shape)
        or len(shape) not in (2, 3)
        or math.prod(shape) * dtype.itemsize > most_bytes
    ):
        raise ValueError("pixels of another kind")
    pixels = np.empty(shape, dtype)
    rest = pixels.data.cast("B")
    while rest:
        count = stream.readinto(rest)  # type: ignore[attr-defined]
        if not count:
            raise ValueError("it has ended")
        rest = rest[count:]
    return pixels


_lock = threading.Lock()
_running: list[_Decoder] = []


def _ask_decoder(request: dict[str, Any], content: bytes, most_bytes: int) -> Array:
    cpu_s = _CPU_S + _CPU_S_PER_BYTE * most_bytes
    request |= {"bytes": len(content), "cpu_s": cpu_s, "memory": _COPIES * most_bytes + 2 * len(content) + _MEMORY}
    with _lock:
        if _running and _running[0].owner != os.getpid():
            _running.pop().close()  # of the process that we were forked from
        if not _running:
            _running.append(_Decoder())
        try:
            answer = _running[0].ask(request, content, most_bytes)
        except TimeoutError:
            _running.pop().end()
            raise RefusedError(f"takes more than {_LIMIT_S:g} s to decode; save it again, as PNG or PFM.") from None
        except _DecoderDiedError:
            status = _running.pop().end()
            if status is not None and system.is_ended_by_time_limit(status):
                raise RefusedError(f"takes more than {cpu_s:.0f} s to decode; save it again, as PNG or PFM.") from None
            raise RefusedError("makes the library crash that decodes it; save it again, as PNG or PFM.") from None
        except BaseException:  # interrupted: its late answer would be taken for the next image
            _running.pop().end()
            raise
    if isinstance(answer, str):
        raise ValueError(answer)
    return answer


@atexit.register
def stop_decoder() -> None:
    """End the other process, if it runs."""
    while _running:
        decoder = _running.pop()
        if decoder.owner == os.getpid():
            decoder.end()
        else:
            decoder.close()


def main(arguments: Sequence[str]) -> int:
    """The other process: decode what comes in until there is no more."""
    del arguments
    source, out = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what libraries print
    while line := source.readline():
        request = json.loads(line)
        content = source.read(request["bytes"])
        pixels: Array | None = None
        decode_now = _make_exr_decoder(request) if "path" in request else _make_image_decoder(content)
        try:
            with system.bound_memory_and_time(request["memory"], request["cpu_s"]):
                pixels = np.ascontiguousarray(decode_now())
            answer: dict[str, Any] = {"shape": pixels.shape, "type": pixels.dtype.str}
        except MemoryError:
            answer = {"error": "it takes more memory than its size"}
        except Exception as error:  # the libraries raise RuntimeError and types of their own
            answer = {"error": (str(error).strip().splitlines() or [type(error).__name__])[-1][:200]}
        try:
            out.write(json.dumps(answer).encode("ascii") + b"\n")
            if pixels is not None:
                out.write(pixels.data.cast("B"))
            out.flush()
        except OSError:  # nobody waits for it any more
            return 0
    return 0


def _make_image_decoder(content: bytes) -> Callable[[], Array]:
    from .image_files import decode_in_this_process  # the library is loaded before time is counted

    return lambda: decode_in_this_process(EncodedImage(content, 0, 0, 0))


def _make_exr_decoder(request: Mapping[str, Any]) -> Callable[[], Array]:
    import OpenEXR

    def decode_channel() -> Array:
        for part in OpenEXR.File(request["path"], separate_channels=True).parts:
            if part.part_index == request["part"]:
                return np.asarray(part.channels[request["channel"]].pixels)
        raise ValueError("its pixels are damaged")  # OpenEXR leaves out a part that it cannot decode

    return decode_channel
