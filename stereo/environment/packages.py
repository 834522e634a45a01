"""The packages that the evaluation needs, and a check of this Python for them.

This module needs none of the packages.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import io
import logging
import platform
import sys
from contextlib import redirect_stderr, redirect_stdout
from typing import Any

from ...support import bundled_wheels
from ...support.errors import IcyMoonError

MIN_PYTHON = (3, 11)

# On its first run Matplotlib prints on standard error that it builds the font cache.
logging.getLogger("matplotlib").setLevel(logging.ERROR)

#: Module -> (name for pip, oldest version that works, first major version that is not tested).
PACKAGES = {
    "numpy": ("numpy", (1, 26), 3),
    "cv2": ("opencv-contrib-python-headless", (4, 11), 6),
    "OpenEXR": ("OpenEXR", (3, 3), 4),
    "jinja2": ("Jinja2", (3, 1), 4),
    "matplotlib": ("matplotlib", (3, 8), 4),
    "rich": ("rich", (15, 0), 16),
}


def check_packages() -> dict[str, Any]:
    """Check all packages.

    Return their versions, whether all is ``ok``, the ``missing`` packages, and a ``message`` with the remedy.
    """
    missing = [problem for _, problem in map(_import_package, PACKAGES) if problem]
    if sys.version_info < MIN_PYTHON:
        missing.insert(0, f"Python {'.'.join(map(str, MIN_PYTHON))} or newer")
    message = (
        f"{sys.executable} cannot evaluate: it lacks {', '.join(missing)}; {_make_install_advice()}" if missing else ""
    )
    return {**find_versions(), "ok": not missing, "missing": missing, "message": message}


def find_versions() -> dict[str, str | None]:
    """Find the versions of Python and of the packages; None for a package that is absent or does not load.

    The required packages are imported, because an installed package may fail to load. torch is slow to load and serves
    the learned matchers only, so it is looked up without an import.
    """
    return {
        "python": platform.python_version(),
        **{module: _import_package(module)[0] for module in PACKAGES},
        "torch": _find_installed_version("torch"),
    }


def is_in_blender() -> bool:
    """Return whether this process is the Blender program, in which OpenEXR crashes; False for Blender as a module."""
    app = getattr(sys.modules.get("bpy"), "app", None)
    return app is not None and not getattr(app, "module", not app.binary_path)


def require_modules(*modules: str) -> None:
    """Raise IcyMoonError with the remedy unless all of ``modules`` load in this Python."""
    if "OpenEXR" in modules and is_in_blender():
        raise IcyMoonError(
            "This needs OpenCV and OpenEXR, which crash inside Blender; press Evaluate in the sidebar, "
            "or run it in a Python of its own, such as python -m icymoon evaluate DATASET."
        )
    problems = [problem for _, problem in map(_import_package, modules) if problem]
    if problems:
        raise IcyMoonError(f"{sys.executable} lacks {', '.join(problems)}; {_make_install_advice()}")


def format_requirement(module: str) -> str:
    """Format a package with its version bounds as a pip requirement."""
    distribution, oldest, untested = PACKAGES[module]
    return f"{distribution}>={'.'.join(map(str, oldest))},<{untested}"


def _import_package(module: str) -> tuple[str | None, str]:
    """Import a module. Return its version or None, and its problem in words, empty if there is no problem."""
    distribution, oldest, untested = PACKAGES[module]
    try:
        # A package may print many lines if it lacks another one.
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            loaded = importlib.import_module(module)
    except Exception as error:  # a broken binary package may raise anything
        reason = f" ({error})" if importlib.util.find_spec(module) else ""
        return None, f"{format_requirement(module)}{reason}"
    # The version of OpenEXR is only in the metadata of the package.
    version = getattr(loaded, "__version__", None) or _find_installed_version(distribution)
    if version and not oldest <= _parse_version(version) < (untested,):
        return version, f"{format_requirement(module)} (it has {version})"
    return version, ""


def _find_installed_version(distribution: str) -> str | None:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


def _parse_version(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split(".")[:2] if part.isdecimal())


def _make_install_advice() -> str:
    if bundled_wheels.find_folder():
        return (
            "these came with Icy Moon, and another extension may have replaced them: install Icy Moon again, or "
            "disable that extension."
        )
    names = " ".join(f'"{format_requirement(module)}"' for module in PACKAGES)
    return f"run {sys.executable} -m pip install {names}, or choose another Python."
