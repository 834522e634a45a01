"""A program that uses the extension's zip in a Blender with an empty profile, in a process of its own."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from collections.abc import Mapping
from pathlib import Path

_END = """
    status = 1
    try:
        main()
        status = 0
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # the Blender module may crash or hang when it is unloaded
    """


def run_main(source: str, archive: Path, folder: Path, environment: Mapping[str, str]) -> None:
    """Run a source that defines ``main`` and imports os, sys and traceback; its arguments are the zip and the folder of
    a data set.

    Raises AssertionError with what it printed if it fails.
    """
    resources = folder / "blender"
    resources.mkdir()
    program = textwrap.dedent(source + _END)
    ended = subprocess.run(
        [sys.executable, "-c", program, str(archive), str(folder / "dataset")],
        timeout=240,
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env={**environment, "BLENDER_USER_RESOURCES": str(resources)},
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
