"""``python -m icymoon …``, also when this file is run by its path.

Inside Blender (``blender -b --python __main__.py -- worker job.json``) and in another Python the package's folder has
any name and is on no search path. This file then loads it as ``icymoon``.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from pathlib import Path
from types import TracebackType

#: Verbs that are separate programs, because the other verbs must work without their imports.
_PROGRAMS = {
    "stereo": "stereo.cli",
    "worker": "render.worker",
    "resident-worker": "render.resident_worker",
    "assets": "render.asset_worker",
    "build": "render.build_worker",
    "geometry": "render.geometry_worker",
    "scan": "render.lidar_worker",
    "project": "render.projector_worker",
    "probe": "render.probe_blender",
    "measure": "stereo.measuring_processes",
    "decode": "stereo.images.bounded_decoding",
    "install": "stereo.environment.install",
}
#: Verbs that run in Blender.
_IN_BLENDER = {"worker", "resident-worker", "assets", "build", "probe"}
#: Versions of Python with Blender as a module, see pyproject.toml; the oldest supported version.
_WITH_BLENDER, _LEAST = ((3, 11), (3, 13)), (3, 11)


def explain_missing_blender() -> str:
    """Explain how to get a Blender for a Python without one."""
    if sys.version_info[:2] in _WITH_BLENDER:
        return f'{sys.executable} has no Blender; give one with --blender, or pip install "icymoon[blender]".'
    return (
        f"{sys.executable} is Python {sys.version_info[0]}.{sys.version_info[1]}, which has no Blender as a "
        'module; give a Blender with --blender, or use Python 3.11 or 3.13 and pip install "icymoon[blender]".'
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the verb with which the arguments begin, and return its exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    system = importlib.import_module("icymoon.support.system")
    importlib.import_module("icymoon.support.printer").open_streams()
    importlib.import_module("icymoon.support.bundled_wheels").use_wheels()
    # These verbs may be busy for minutes, and leave nothing half done if they are stopped at once.
    system.stop_with_starter(at_once=arguments[:1] in (["worker"], ["resident-worker"], ["assets"], ["build"]))
    if arguments and arguments[0] in _PROGRAMS:
        with system.silence_interrupts():
            if arguments[0] in _IN_BLENDER and (fault := _find_blender_fault()):
                importlib.import_module("icymoon.support.printer").emit("error", message=fault)
                return 1
            program = importlib.import_module(f"icymoon.{_PROGRAMS[arguments[0]]}")
        return int(program.main(arguments[1:]))
    with system.silence_interrupts():
        program = importlib.import_module("icymoon.commands.cli")
    return int(program.main(arguments))


def _find_blender_fault() -> str:
    """Explain why Blender cannot be loaded as a module, with the fix; empty if it can, or if the error is unknown."""
    if "bpy" in sys.modules:
        return ""
    if importlib.util.find_spec("bpy") is None:
        return explain_missing_blender()
    try:
        importlib.import_module("bpy")
    except ImportError as error:
        return str(importlib.import_module("icymoon.support.system").explain_missing_library(str(error)))
    return ""


def _end_quietly(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """End without a message at a Ctrl-C before the command has begun; show any other error."""
    if issubclass(kind, KeyboardInterrupt):
        os._exit(130)
    sys.__excepthook__(kind, error, trace)


def _load_package() -> None:
    root = Path(__file__).resolve().parent
    spec = importlib.util.spec_from_file_location(
        "icymoon", root / "__init__.py", submodule_search_locations=[str(root)]
    )
    assert spec is not None
    assert spec.loader is not None
    package = importlib.util.module_from_spec(spec)
    sys.modules["icymoon"] = package
    spec.loader.exec_module(package)


def _arguments() -> list[str]:
    inside_blender = "bpy" in sys.modules
    if inside_blender:
        importlib.import_module("icymoon.support.system").raise_at_interrupt()
        return sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    return sys.argv[1:]


if __name__ == "__main__":
    if sys.version_info < _LEAST:
        sys.exit(f"icymoon: needs Python 3.11 or later, this is {sys.version.split()[0]}; run it with a later one.")
    sys.excepthook = _end_quietly
    if not __package__:
        sys.path[:] = [p for p in sys.path if Path(p or ".").resolve() != Path(__file__).resolve().parent]
        _load_package()
    try:
        sys.exit(main(_arguments()))
    except ModuleNotFoundError as error:
        if error.name not in ("numpy", "rich"):
            raise
        sys.exit(
            f"icymoon: {sys.executable} lacks {error.name}; run make, which makes an environment in .venv, or in "
            f"the folder of icymoon: {sys.executable} -m pip install ."
        )
