"""A program of the user's that is started once and answers pair after pair, over lines of JSON.

The program, most simply by ``adapters.icymoon_serve``, prints ``{"hello": 1}`` when it is ready. For each pair it reads
a line ``{"id", "left", "right", "out", "confidence", "camera", "range"}`` with the paths of two npy files (uint8 RGB,
(H, W, 3)), the camera and the disparities that the rig can see, or null. It writes the disparity to ``out`` as npy, and
then prints ``{"id", "ok": true}`` with its time and memory, or ``{"id", "error"}``. It may write a confidence to
``confidence`` as npy; then its answer has ``"confidence"`` with the kind of its numbers, see ``result``. Other output
is not a message. Its standard input ends when this process ends, however that happens.

If a program dies or does not answer in time, this pair fails and the program is started again for the next one, but not
after three such failures in a row. The first pair is computed twice, because libraries and GPUs do much of their work
only once; the time of the first run is stated apart.
"""

from __future__ import annotations

import atexit
import json
import os
import queue
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...support import system
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.file_schemas import is_number
from ...support.foreign_bytes import parse_json
from ...support.printer import show_controls
from ...support.temporary_folders import make_scratch_folder
from ..adapters.icymoon_serve import PROTOCOL, to_disparity_map
from ..measure.metrics import COSTS
from .result import CONFIDENCE_KINDS, Confidence, Result
from .user_programs import read_array, read_last_line, read_written_array

#: Folder in which a program finds ``icymoon_serve``.
ADAPTERS = Path(__file__).parents[1] / "adapters"
#: Facts of the camera that a program gets.
CAMERA_KEYS = ("focal_px", "cx_px", "cy_px", "baseline_m")
#: Failures in a row after which a program is not started again.
_MAX_FAILURES = 3
#: Seconds between two checks for an answer, and seconds in which a program may end by itself.
_POLL_S, _GRACE_S = 0.25, 2.0
#: Limits of answers: bytes of a line, lines that wait to be read, number of facts, and characters of a fact.
_LONGEST_LINE, _MAX_LINES, _MAX_FACTS, _LONGEST_FACT = 65536, 64, 50, 200


@dataclass(frozen=True)
class Program:
    """A program to start: its name in messages, its command, and time limits for its start and for a pair."""

    name: str
    command: tuple[str, ...]
    start_s: int
    timeout_s: int


class _ProgramError(Exception):
    """The fault of a program, worded to follow its name."""


class _Resident:
    """A running program of a matcher that answers pairs."""

    def __init__(self, program: Program) -> None:
        """Start the program and wait until it is ready. Raises _ProgramError if it fails, and IcyMoonError if there is
        no temporary folder.
        """
        self._program, self._folder = program, make_scratch_folder()
        self._lines: queue.Queue[bytes] = queue.Queue(_MAX_LINES)
        self._stray, self._id = "", 0
        paths = [os.environ.get("PYTHONPATH", ""), str(ADAPTERS)]
        begun = time.monotonic()
        try:
            with (self._folder / "errors.txt").open("wb") as errors:
                self._process = system.start(
                    program.command,
                    {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))},
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=errors,
                )
        except OSError as error:
            system.remove_folder(self._folder)
            raise _ProgramError(f"cannot be run ({error.strerror}); check {program.command[0]}.") from None
        self._reader = threading.Thread(target=self._queue_lines, args=(self._process.stdout,), daemon=True)
        self._reader.start()
        try:
            hello = self._wait_for("hello", program.start_s)
            if not _is_number(hello["hello"], PROTOCOL):
                raise _ProgramError(
                    f"speaks version {str(hello['hello'])[:40]} of the protocol, not {PROTOCOL}; copy "
                    f"{ADAPTERS / 'icymoon_serve.py'} beside it."
                )
        except BaseException:
            self.stop(0.0)
            raise
        self.facts = {**_read_text_entries(hello, "name"), "start_seconds": round(time.monotonic() - begun, 3)}
        self._warm = False

    def compute(self, left: Array, right: Array, camera: StereoCamera | None, range_px: Sequence[int] | None) -> Result:
        """Compute the disparity of a pair. Raises _ProgramError if the program fails, and IcyMoonError for an error
        that it reports.
        """
        if not self._warm:
            begun = time.monotonic()
            self._ask(left, right, camera, range_px, self._program.start_s + self._program.timeout_s)
            self.facts["first_seconds"] = round(time.monotonic() - begun, 3)
            self._warm = True
        disparity, confidence, answer, waited = self._ask(left, right, camera, range_px, self._program.timeout_s)
        facts = answer.get("facts")
        stated = (
            {
                key[:_LONGEST_FACT]: value[:_LONGEST_FACT] if isinstance(value, str) else value
                for key, value in list(facts.items())[:_MAX_FACTS]
                if isinstance(value, str | int | float)
            }
            if isinstance(facts, dict)
            else {}
        )
        costs = {"wall_seconds": waited, "memory_mb": system.measure_peak_memory_mib_of(self._process.pid)}
        costs |= {key: answer.get(given) for key, given in _COST_NAMES.items() if _is_cost(answer.get(given))}
        costs.setdefault("seconds", costs["wall_seconds"])
        return Result(
            disparity,
            facts={**self.facts, **stated, **_read_text_entries(answer, "gpu")},
            costs={key: value for key, value in costs.items() if value is not None},
            confidence=confidence,
        )

    def _ask(
        self,
        left: Array,
        right: Array,
        camera: StereoCamera | None,
        range_px: Sequence[int] | None,
        limit_s: float,
    ) -> tuple[Array, Confidence | None, dict[str, Any], float]:
        """Request a pair from the program; return the disparity, its confidence, the answer, and the elapsed
        seconds.
        """
        self._id += 1
        paths = {key: self._folder / f"{key}{self._id}.npy" for key in ("left", "right", "out", "confidence")}
        try:
            np.save(paths["left"], left)
            np.save(paths["right"], right)
            request = {
                "id": self._id,
                **{key: str(path) for key, path in paths.items()},
                "camera": camera and {key: float(getattr(camera, key)) for key in CAMERA_KEYS},
                "range": range_px,
            }
            begun = time.monotonic()
            self._write_request(request)
            answer = self._wait_for("id", limit_s)
            waited = time.monotonic() - begun
            if answer.get("ok") is not True:
                reason = " ".join(str(answer.get("error", "neither ok nor an error")).split())
                raise IcyMoonError(f"{self._program.name} reports {reason[:300]}; correct the program.")
            shape = left.shape[:2]
            confidence = self._read_confidence(answer.get("confidence"), paths["confidence"], shape)
            return self._read_disparity(paths["out"], shape), confidence, answer, waited
        finally:
            for path in paths.values():
                with suppress(OSError):  # the program may have made a folder there; it goes with the others
                    system.remove(path)

    def _write_request(self, request: Mapping[str, Any]) -> None:
        assert self._process.stdin is not None
        with suppress(OSError):  # a program that has ended is noticed where its answer is read
            self._process.stdin.write(json.dumps(request).encode("ascii") + b"\n")
            self._process.stdin.flush()

    def _wait_for(self, key: str, limit_s: float) -> dict[str, Any]:
        """Wait for the next message with this key: the hello, or the answer to the last request. Raises _ProgramError
        if none comes in ``limit_s``.
        """
        end = time.monotonic() + limit_s
        while (left_s := end - time.monotonic()) > 0:
            try:  # in short steps, since Windows cannot interrupt a long wait
                line = self._lines.get(timeout=min(_POLL_S, left_s))
            except queue.Empty:
                if self._process.poll() is None:
                    continue
                line = b""  # the program has ended, but a child process keeps its output open
            if not line:
                raise _ProgramError(self._describe_end("it was ready" if key == "hello" else "it had answered"))
            message = _parse_message(line)
            if message is None or key not in message:
                self._stray = show_controls(line.decode("utf-8", "replace").strip()) or self._stray
            elif key == "hello" or _is_number(message["id"], self._id):
                return message
        matcher = self._program.name.partition(".")[0]
        what, option = ("to be ready", "start_s") if key == "hello" else ("for a pair", "timeout_s")
        raise _ProgramError(
            f"took more than {limit_s:g} s {what} and was stopped ({self._read_last_error()}); raise "
            f"{matcher}.{option} or make it faster."
        )

    def _describe_end(self, before: str) -> str:
        try:
            status = self._process.wait(_GRACE_S)
        except subprocess.TimeoutExpired:
            return f"closed its output before {before} ({self._read_last_error()}); keep it open."
        how = f"was ended by signal {-status}" if status < 0 else f"ended with status {status}"
        return f"{how} before {before} ({self._read_last_error()}); correct the program."

    def _read_last_error(self) -> str:
        """Read the last line of the program's standard error, or else of its output that is not a message."""
        return read_last_line(self._folder / "errors.txt") or self._stray[:300] or "no message"

    def _read_disparity(self, path: Path, shape: tuple[int, ...]) -> Array:
        try:
            return to_disparity_map(read_array(path, shape), shape)
        except FileNotFoundError:
            raise IcyMoonError(
                f"{self._program.name} answered that the pair is done, but wrote no disparity map; save "
                "it to out before."
            ) from None
        except (OSError, ValueError, IcyMoonError) as error:
            raise IcyMoonError(
                f"{self._program.name} wrote a disparity map that cannot be used: "
                f"{' '.join(str(error).split())[:300].rstrip('.')}."
            ) from None

    def _read_confidence(self, kind: object, path: Path, shape: tuple[int, ...]) -> Confidence | None:
        """Read the confidence of the ``kind`` that the answer states; None if it states none."""
        if kind is None:
            return None
        if kind not in CONFIDENCE_KINDS:
            raise IcyMoonError(
                f"{self._program.name} answered with the confidence {str(kind)[:40]!r}; answer with one of "
                f"{', '.join(CONFIDENCE_KINDS)}."
            )
        return Confidence(read_written_array(self._program.name, "confidence", path, shape), str(kind))

    def _queue_lines(self, stream: IO[bytes]) -> None:
        with suppress(OSError, ValueError), stream:  # it was closed
            while line := stream.readline(_LONGEST_LINE):
                self._lines.put(line)  # a full queue makes a program that prints without end wait
                while len(line) == _LONGEST_LINE and not line.endswith(b"\n"):
                    line = stream.readline(_LONGEST_LINE)  # the rest of a line that is not a message
        self._lines.put(b"")

    def stop(self, grace_s: float) -> None:
        """Give the program some time to end by itself, then end it and all processes that it has started."""
        assert self._process.stdin is not None
        with suppress(OSError):
            self._process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(grace_s)
        system.kill_all(self._process)
        end = time.monotonic() + _GRACE_S
        while self._reader.is_alive() and time.monotonic() < end:  # the reader may wait for room in the queue
            with suppress(queue.Empty):
                self._lines.get(timeout=0.01)
        system.remove_folder(self._folder)


_running: dict[Program, _Resident] = {}
#: The number of failures in a row of each program, and its last failure.
_failed: dict[Program, tuple[int, str]] = {}


def start_resident(program: Program) -> None:
    """Start a program if it does not run yet. Raises IcyMoonError if it cannot start or has failed too often."""
    count, reason = _failed.get(program, (0, ""))
    if count >= _MAX_FAILURES:
        raise IcyMoonError(
            f"{program.name} failed {count} times in a row and is not started again; the last time it {reason}"
        )
    if program not in _running:
        try:
            _running[program] = _Resident(program)
        except _ProgramError as failure:
            raise _record_failure(program, failure) from None


def match_with_resident(
    program: Program,
    left: Array,
    right: Array,
    camera: StereoCamera | None,
    range_px: Sequence[int] | None = None,
) -> Result:
    """Compute the disparity of uint8 RGB (H, W, 3) images; ``range_px`` are the least and the greatest disparity to
    expect, if known.

    Raises IcyMoonError if the program fails.
    """
    start_resident(program)
    try:
        result = _running[program].compute(left, right, camera, range_px)
    except _ProgramError as failure:
        _running.pop(program).stop(0.0)
        raise _record_failure(program, failure) from None
    _failed.pop(program, None)
    return result


def _record_failure(program: Program, failure: _ProgramError) -> IcyMoonError:
    _failed[program] = _failed.get(program, (0, ""))[0] + 1, str(failure)
    return IcyMoonError(f"{program.name} {failure}")


@atexit.register
def stop_residents() -> None:
    """End all programs, and forget their failures."""
    _failed.clear()
    while _running:
        _running.popitem()[1].stop(_GRACE_S)


#: The name of each cost here, and its name in an answer.
_COST_NAMES = dict(zip(COSTS, ("cpu_seconds", "seconds", "gpu_seconds", "gpu_mb", "memory_mb"), strict=True))


def _is_cost(value: object) -> bool:
    return is_number(value) and value >= 0


def _is_number(value: object, number: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value == number


def _read_text_entries(message: Mapping[str, Any], key: str) -> dict[str, str]:
    value = message.get(key)
    return {key: value[:200]} if isinstance(value, str) else {}


def _parse_message(line: bytes) -> dict[str, Any] | None:
    try:
        message = parse_json(line.decode("utf-8", "replace"))
    except ValueError:
        return None
    return dict(message) if isinstance(message, dict) else None
