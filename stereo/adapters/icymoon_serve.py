"""Lets Icy Moon evaluate your stereo network: your program is started once and answers pair after pair.

    from icymoon_serve import serve

    network = load_my_network()
    serve(lambda left, right, camera: network(left, right))

Needs Python 3.8 and NumPy, nothing else. A program that Icy Moon starts finds this module without an installation; to
use it elsewhere, copy this file beside your program.

Icy Moon writes a line of JSON per pair to the standard input, and reads the answers as lines of JSON from the standard
output; see "Without Python" in the manual's page on your own matcher. Other output of the program goes to the standard
error.
"""

from __future__ import annotations

import json
import os
import queue
import sys
import threading
import time
import traceback
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import IO, TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import torch

PROTOCOL = 1
#: Share of negative numbers above which a disparity map has the wrong sign.
_WRONG_SIGN = 0.99
_MIB = 2**20


def serve(
    disparity: Callable[[np.ndarray, np.ndarray, Any], Any], name: str = "", facts: Callable[[], dict[str, Any]] = dict
) -> None:
    """Answer Icy Moon's pairs with ``disparity(left, right, camera)`` until Icy Moon ends.

    ``left`` and ``right`` are uint8 RGB (H, W, 3). ``camera`` has ``focal_px``, ``cx_px``, ``cy_px`` (from the outer
    corner of the first pixel), ``baseline_m`` and ``range_px``, the least and the greatest disparity that the rig can
    see, or None. ``camera`` itself is None if it is unknown. The function returns the disparity of the left image (H,
    W) in px, left column minus right column, as an array or a tensor of PyTorch; NaN or 0 where nothing was measured.
    It may return a tuple of the disparity and a confidence (H, W) from 0 to 1; for an expected error of e px, the
    confidence is exp(-e). After an exception, only this pair fails. The report states ``name`` and the result of
    ``facts()``.
    """
    if sys.stdin is None or sys.stdin.isatty():
        sys.exit(
            f"{sys.argv[0]} is started by Icy Moon: give it to evaluate with --method "
            f"'NAME=resident:command=python {sys.argv[0]}'."
        )
    requests, answers = _take_streams()
    lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_queue_requests, args=(requests, lines), daemon=True).start()
    _write_message(answers, {"hello": PROTOCOL, "name": name or os.path.basename(sys.argv[0])})
    while True:
        request = json.loads(lines.get())
        try:
            answer = {"id": request["id"], "ok": True, **_answer_request(disparity, request), "facts": facts()}
            json.dumps(answer, allow_nan=False)  # refuses facts that JSON cannot represent
        except Exception as error:
            traceback.print_exc()
            answer = {"id": request["id"], "error": f"{type(error).__name__}: {error}"[:1000]}
        _write_message(answers, answer)


def drop_single_axes(values: np.ndarray) -> np.ndarray:
    """Reduce (1, H, W), (H, W, 1) and the like to (H, W): networks return a batch or a channel of one."""
    while values.ndim > 2 and 1 in (values.shape[0], values.shape[-1]):
        values = values[0] if values.shape[0] == 1 else values[..., 0]
    return values


def to_numpy(found: Any) -> np.ndarray:
    """Convert an array, or a PyTorch tensor on any device and of any type, to a NumPy array."""
    return np.asarray(found.detach().float().cpu().numpy() if hasattr(found, "detach") else found)


def to_disparity_map(found: object, shape: tuple[int, ...]) -> np.ndarray:
    """Convert the output of a program to float32 (H, W).

    Raises ValueError, with the remedy, if it is no disparity map.
    """
    found = drop_single_axes(to_numpy(found))
    if found.dtype.kind not in "fiu":
        raise ValueError(f"the disparity map has values of type {found.dtype}; return numbers")
    if found.shape != tuple(shape):
        raise ValueError(
            f"the disparity map has the shape {found.shape}, the images have {tuple(shape)}; return one "
            "of the size of the left image"
        )
    finite = found[np.isfinite(found)]
    if not finite.size:
        raise ValueError("the disparity map has no finite number; the network or its parameters are damaged")
    if (finite < 0).mean() >= _WRONG_SIGN:
        raise ValueError("the disparities are negative; return left column minus right column, so multiply by -1")
    return found.astype(np.float32)


def _take_streams() -> tuple[IO[bytes], IO[bytes]]:
    """Take over the standard streams for the protocol; return requests and answers.

    Text that libraries print must not mix with the answers. On Windows, libraries also wait for a standard input that
    another thread reads.
    """
    sys.stdout.flush()
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    return requests, answers


def _queue_requests(requests: IO[bytes], lines: queue.SimpleQueue[bytes]) -> None:
    try:
        for line in requests:
            lines.put(line)
    finally:
        os._exit(0)  # Icy Moon has ended, perhaps while a pair is being computed


def _write_message(answers: IO[bytes], message: dict[str, Any]) -> None:
    answers.write(json.dumps(message).encode("ascii") + b"\n")
    answers.flush()


def _answer_request(disparity: Callable[..., Any], request: dict[str, Any]) -> dict[str, Any]:
    """Compute one pair, write its disparity, and return the time and memory of the computation."""
    left, right = (np.load(request[eye], allow_pickle=False) for eye in ("left", "right"))
    camera = None
    if request.get("camera"):
        camera = SimpleNamespace(**request["camera"], range_px=request.get("range"))
    begin = _record_gpu_event()
    wall, cpu = time.perf_counter(), time.process_time()
    found = disparity(left, right, camera)
    found, *stated = found if isinstance(found, tuple) else (found,)
    if len(stated) > 1:
        raise ValueError(f"the function returned {1 + len(stated)} values; return the disparity and its confidence")
    found = to_disparity_map(found, left.shape[:2])  # waits for the GPU
    took = {"seconds": time.perf_counter() - wall, "cpu_seconds": time.process_time() - cpu, **_measure_gpu_use(begin)}
    np.save(request["out"], found)
    if stated and "confidence" in request:  # an older Icy Moon asks for no confidence
        np.save(request["confidence"], np.asarray(to_numpy(stated[0]), np.float32))
        took["confidence"] = "confidence"
    return {**took, **_measure_peak_memory()}


def _find_cuda() -> ModuleType | None:
    """Return PyTorch's CUDA module if the program uses it; None otherwise."""
    torch = sys.modules.get("torch")
    cuda = getattr(torch, "cuda", None)
    return cuda if cuda is not None and cuda.is_available() and cuda.is_initialized() else None


def _record_gpu_event() -> torch.cuda.Event | None:
    cuda = _find_cuda()
    if cuda is None:
        return None
    event = cuda.Event(enable_timing=True)
    event.record()
    return event


def _measure_gpu_use(begin: torch.cuda.Event | None) -> dict[str, Any]:
    """Return the name of the GPU, its peak memory so far, and its time since ``begin``; empty without CUDA."""
    cuda = _find_cuda()
    if cuda is None:
        return {}
    use = {"gpu": cuda.get_device_name(), "gpu_mb": cuda.max_memory_allocated() / _MIB}
    end = _record_gpu_event()
    cuda.synchronize()
    return {**use, "gpu_seconds": begin.elapsed_time(end) / 1000} if begin is not None else use


def _measure_peak_memory() -> dict[str, float]:
    """Return the peak memory of this process, on Linux; empty on other systems."""
    try:
        with open("/proc/self/status", encoding="ascii", errors="replace") as stream:
            return {"memory_mb": next(int(line.split()[1]) for line in stream if line.startswith("VmHWM:")) / 1024}
    except (OSError, StopIteration):
        return {}
