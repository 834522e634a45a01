"""The packages inside a store build of the extension, and the Python that evaluates with them.

Blender unpacks the wheels of all extensions into one folder of the user. The evaluator uses the wheels in a separate
process: Blender's Python, started as a program. Inside Blender the wheels must not be loaded, since OpenEXR's wheel and
Blender's own OpenEXR have the same names, and writing a file crashes. Imports no Blender.
"""

from __future__ import annotations

import os
import site
import sys
from functools import cache
from pathlib import Path

from .system import find_pythons, is_python, run
from .version import ROOT

#: Environment variable that gives our processes the prefix of Blender's Python and the folder of the wheels, separated
#: by os.pathsep.
WHEELS_VARIABLE = "ICYMOON_WHEELS"
#: Code that prints a Python's version and prefix, if it has numpy.
_TRIAL_CODE = "import sys, numpy; print(*sys.version_info[:2], sys.prefix)"
_TRIAL_TIMEOUT_S = 60.0


def has_bundled_wheels(root: Path = ROOT) -> bool:
    """Return whether this is a store build: an extension with wheels inside."""
    return any((root / "wheels").glob("*.whl"))


def share_wheels(extensions: Path) -> None:
    """Give our child processes the folder in which Blender has unpacked the wheels. ``extensions`` is the folder of the
    user's extensions. Does nothing except in store builds."""
    version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    folder = extensions / ".local" / "lib" / version / "site-packages"
    if has_bundled_wheels():
        os.environ[WHEELS_VARIABLE] = f"{sys.prefix}{os.pathsep}{folder}"


def unshare_wheels() -> None:
    """Undo ``share_wheels``."""
    os.environ.pop(WHEELS_VARIABLE, None)


def find_folder() -> str:
    """Find the folder of the wheels if this process is Blender's Python, run as a program; else empty."""
    prefix, _, folder = os.environ.get(WHEELS_VARIABLE, "").rpartition(os.pathsep)
    ours = prefix and os.path.realpath(prefix) == os.path.realpath(sys.prefix)
    return folder if ours and "bpy" not in sys.modules and os.path.isdir(folder) else ""


def use_wheels() -> None:
    """Make this process prefer the wheels to installed packages, as Blender does. Does nothing in another Python."""
    folder = find_folder()
    if folder and folder not in sys.path:
        installed = {*site.getsitepackages(), site.getusersitepackages()}
        place = next((k for k, path in enumerate(sys.path) if path in installed), len(sys.path))
        sys.path.insert(place, folder)


@cache
def find_python() -> str | None:
    """Find Blender's own Python as a program; None if no candidate has Blender's numpy.

    Blender's ``sys.executable`` may be any Python on the search path, so each candidate is tried.
    """
    for candidate in (Path(sys.executable), *find_pythons(Path(sys.base_prefix))):
        if is_python(str(candidate)) and candidate.is_file() and _is_python_of_blender(candidate):
            return str(candidate)
    return None


def _is_python_of_blender(python: Path) -> bool:
    outside = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    try:
        done = run([str(python), "-I", "-c", _TRIAL_CODE], outside, _TRIAL_TIMEOUT_S)
    except OSError:  # TimeoutError is one
        return False
    major, minor, prefix = ([*done.stdout.strip().split(" ", 2), "", "", ""])[:3]
    return (major, minor) == tuple(map(str, sys.version_info[:2])) and (
        os.path.realpath(prefix) == os.path.realpath(sys.prefix)
    )
