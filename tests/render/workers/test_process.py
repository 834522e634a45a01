"""What ended a process that could not state it is told from what it printed, in either Blender's way."""

from __future__ import annotations

import sys

import pytest
from icymoon.render.workers.process import Process, describe_end

FAREWELL = "Error: script failed, file: 'main.py', exiting.\nBlender 4.3.2\n\nBlender quit\n"
TRACE = 'Traceback (most recent call last):\n  File "a.py", line 1, in <module>\n    import cv2\n    ^^^^^^^^^^\n'


def cause(printed: str) -> str:
    """What a process that prints this and fails ended by."""
    process = Process([sys.executable, "-c", f"import sys; sys.stdout.write({printed!r}); sys.exit(1)"])
    list(process.wait_for_messages())
    assert process.returncode == 1
    return process.cause


@pytest.mark.parametrize(
    ("printed", "expected"),
    [
        (
            TRACE + "ModuleNotFoundError: No module named 'cv2'\n\n" + FAREWELL,
            "ModuleNotFoundError: No module named 'cv2'",
        ),
        ("Blender 5.2.2 LTS\nicymoon: it lacks rich; run make\n", "icymoon: it lacks rich; run make"),
        (
            TRACE
            + "KeyError: 1\n\nDuring handling of the above exception, another exception occurred:\n\n"
            + TRACE
            + "ValueError: the last\n"
            + FAREWELL,
            "ValueError: the last",
        ),
        (TRACE + "Lost: of no usual name\n" + FAREWELL, "Lost: of no usual name"),
        ("  cut off\n  File\nOSError: a long traceback\n" + FAREWELL, "OSError: a long traceback"),
        ("x\n" * 40 + TRACE + "MemoryError\n" + FAREWELL, "MemoryError"),
        (TRACE + "    killed while it printed\n", "    killed while it printed"),
        ("Fra:1 Mem:20M\nKilled\n", "Killed"),
        ("Blender 4.3.2\n\nBlender quit\n", "Blender quit"),
        ('{"type": "progress", "fraction": 0.5, "message": "half"}\n', "it printed nothing"),
    ],
)
def test_the_error_is_told_and_not_the_farewell(printed, expected):
    assert cause(printed) == expected


def test_a_blender_that_fails_to_import_is_told_in_the_error_of_the_job(tmp_path):
    """As Dry Run shows it in the window."""
    from icymoon.operators.jobs import Job

    program = tmp_path / "program.py"
    program.write_text("import a_module_that_is_not_there\n")
    process = Process([sys.executable, str(program)])
    job = Job("Dry Run", process, lambda message: None, lambda: None)
    while job.poll():
        pass
    assert job.failure == (
        "Dry Run ended without a result (status 1): ModuleNotFoundError: No module named 'a_module_that_is_not_there'"
    )


def test_a_killed_process_is_told_with_a_remedy():
    """The kernel kills a process that takes too much memory, and nothing is printed then."""
    process = Process([sys.executable, "-c", "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"])
    assert list(process.wait_for_messages()) == []
    assert describe_end(process) == (
        "was killed, often for lack of memory; close other programs or choose a smaller scene, then try again"
    )
