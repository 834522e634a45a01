"""Programs in a process of their own that may take little memory and time, as hostile input must."""

from __future__ import annotations

import os
import resource
import subprocess
import sys

#: Memory and processor seconds that hostile input may take, beside those of the loaded modules.
MEMORY, SECONDS = 500 * 10**6, 5
#: Address space that Python takes with numpy, OpenCV and OpenEXR.
_MODULES = 600 * 10**6


def run_bounded(program: str, memory: int = MEMORY, seconds: int = SECONDS) -> str:
    """What a Python program prints. Fails if it ends badly, or needs more than this."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (memory + _MODULES,) * 2)
        resource.setrlimit(resource.RLIMIT_CPU, (seconds + 5,) * 2)  # loading modules takes some

    ended = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        timeout=100,
        check=False,
        text=True,
        preexec_fn=limit,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )
    assert ended.returncode == 0, ended.stderr[-2000:]
    return ended.stdout
