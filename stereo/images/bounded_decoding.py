"""Decode foreign images with bounded memory and time.

OpenCV and OpenEXR have had memory errors, and files of a few kB can keep them busy for minutes. So another process
decodes foreign images. It starts with the first such image and stays: it receives a line of JSON and a file, and
answers with a line of JSON and the pixels. Its memory and time are limited in proportion to the stated size. A decoder
that crashes or takes longer is ended, and the next image gets a new decoder. The decoder ends when its input ends,
however this process ends.

Pixels whose size differs from the file's header are refused.
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

#: Seconds for an image: the largest takes 4 s, and a machine may be busy with other work.
_MAX_DECODING_S = 60.0
#: Processor time of a decoder: the time to load the libraries, and ten times the time of the slowest format, 100 MB/s.
_CPU_S, _CPU_S_PER_BYTE = 2.0, 1e-7
#: Memory of a decoder: copies of the pixels (progressive JPEG has coefficients of two bytes), and bytes for the file.
_PIXEL_COPIES, _FILE_BYTES = 3, 2**26
#: Seconds between two checks for an answer.
_POLL_S = 0.25
#: Most bytes of a line of an answer.
_LONGEST_LINE = 10_000
_PIXEL_TYPES = ("u1", "u2", "u4", "i1", "i2", "i4", "f2", "f4", "f8")
#: One thread each: a second thread would take address space, and processor time that counts.
_ONE_THREAD_ENVIRONMENT = {"MALLOC_ARENA_MAX": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def decode(image: EncodedImage) -> Array:
    """Decode an image to pixels (H, W) or (H, W, 3 or 4) in OpenCV's order of channels.

    Raises ValueError if it is damaged, RefusedError if it cannot be decoded within the bounds.
    """
    pixels = _ask_decoder({}, image.content, image.most_bytes)
    if pixels.shape[:2] != (image.height, image.width):
        raise ValueError(f"its size is not {image.width} x {image.height} px")
    return pixels


def decode_exr(path: Path, channel: Channel, all_bytes: int) -> Array:
    """Decode one channel of an EXR file, whose channels have ``all_bytes``, to pixels (H, W). Raises as ``decode``
    does.
    """
    request = {"path": str(path), "part": channel.part, "channel": channel.name}
    pixels = _ask_decoder(request, b"", all_bytes)
    if pixels.shape != (channel.height, channel.width) or pixels.dtype != channel.dtype:
        raise ValueError(f"its size is not {channel.width} x {channel.height} px")
    return pixels


class _DecoderDiedError(Exception):
    """The decoding process has ended."""


class _Decoder:
    """A process that decodes images for the present process."""

    def __init__(self) -> None:
        from ...render.workers.job_commands import python_command

        self.owner = os.getpid()
        try:
            self._process = system.start(
                python_command(sys.executable, "decode"),
                {
                    **os.environ,
                    **system.KEEPS_MEMORY,
                    **_ONE_THREAD_ENVIRONMENT,
                },  # the same Python finds the same packages
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
        """Return the decoder's pixels, or its error in words. Raises _DecoderDiedError if the decoder has ended,
        TimeoutError if it takes too long.
        """
        answer: queue.SimpleQueue[Array | str | None] = queue.SimpleQueue()
        # A thread, since Windows cannot wait for a pipe with a limit.
        threading.Thread(target=self._exchange, args=(request, content, most_bytes, answer), daemon=True).start()
        end = time.monotonic() + _MAX_DECODING_S
        while time.monotonic() < end:
            with suppress(queue.Empty):  # in short steps, since Windows cannot interrupt a long wait
                found = answer.get(timeout=_POLL_S)
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
        except Exception:  # after another answer, nothing more is expected
            answer.put(None)

    def end(self) -> int | None:
        """End the decoder. Return its exit status if it had ended before, else None."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_POLL_S)
        status = self._process.poll()
        system.kill_all(self._process)
        self.close()
        return status

    def close(self) -> None:
        """Close our ends of the decoder's pipes, which forked processes have copied."""
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            with suppress(OSError):  # the decoder left input unread
                stream.close()


def _read_answer(stream: IO[bytes], most_bytes: int) -> Array | str:
    """Read the pixels, or the error in words. Raises ValueError for any other answer."""
    line = stream.readline(_LONGEST_LINE)
    if not line.endswith(b"\n"):
        raise ValueError("it has ended")
    answer = parse_json(line)
    if "error" in answer:
        return str(answer["error"])[:200]
    shape, dtype = answer["shape"], np.dtype(answer["type"])
    if (
        dtype.str[1:] not in _PIXEL_TYPES
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
    request |= {
        "bytes": len(content),
        "cpu_s": cpu_s,
        "memory": _PIXEL_COPIES * most_bytes + 2 * len(content) + _FILE_BYTES,
    }
    with _lock:
        if _running and _running[0].owner != os.getpid():
            _running.pop().close()  # the decoder belongs to the process from which we were forked
        if not _running:
            _running.append(_Decoder())
        try:
            answer = _running[0].ask(request, content, most_bytes)
        except TimeoutError:
            _running.pop().end()
            raise RefusedError(
                f"takes more than {_MAX_DECODING_S:g} s to decode; save it again, as PNG or PFM."
            ) from None
        except _DecoderDiedError:
            status = _running.pop().end()
            if status is not None and system.is_ended_by_time_limit(status):
                raise RefusedError(f"takes more than {cpu_s:.0f} s to decode; save it again, as PNG or PFM.") from None
            raise RefusedError("makes the library crash that decodes it; save it again, as PNG or PFM.") from None
        except BaseException:  # after an interrupt, its late answer would be taken for the next image
            _running.pop().end()
            raise
    if isinstance(answer, str):
        raise ValueError(answer)
    return answer


@atexit.register
def stop_decoder() -> None:
    """End the decoder if it is running."""
    while _running:
        decoder = _running.pop()
        if decoder.owner == os.getpid():
            decoder.end()
        else:
            decoder.close()


def main(arguments: Sequence[str]) -> int:
    """Run the decoder: decode images until the input ends. Return the exit code."""
    del arguments
    source, out = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # drops the output of libraries
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
        except OSError:  # nobody waits for the answer any more
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
