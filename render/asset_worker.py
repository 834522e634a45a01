"""The program that makes the asset library in a separate Blender, so that the window stays usable.

__main__.py assets FOLDER [KIND/NAME ...]      all assets by default
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from ..formats.asset_library import install_library
from ..nodes.assets import list_asset_names, write_asset
from ..support.printer import emit
from ..support.temporary_folders import open_scratch_folder
from .worker import run_to_exit

_NO_MEMORY_MESSAGE = "There is not enough memory to make the asset library; close other programs and make it again."


def make_library(folder: Path, names: Sequence[str], send: Callable[..., None] = emit) -> None:
    """Make the assets of shipped presets and install them as a library in ``folder``.

    The assets are made in a temporary folder, so an earlier library stays whole until the new library is complete.
    ``send(type, **facts)`` receives ``progress`` and ``done`` messages. Raises IcyMoonError if an asset cannot be made.
    """
    with open_scratch_folder() as made:
        for k, name in enumerate(names):
            send("progress", fraction=k / len(names), message=f"Asset {k + 1} of {len(names)}")
            write_asset(name, made / f"{name}.blend")
        files = install_library(made, folder)
    send("done", assets=len(files))


def main(arguments: list[str]) -> int:
    """Make the library, and end the process (``run_to_exit``). Arguments: the folder of the library and, if not all are
    wanted, the names of the assets."""
    folder, *names = arguments
    run_to_exit(lambda: make_library(Path(folder), names or list_asset_names()), lambda: _NO_MEMORY_MESSAGE)
