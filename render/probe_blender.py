"""Prints the abilities of the Blender that runs this script, as one JSON line."""

from __future__ import annotations

import os
import platform
import sys

import bpy

from ..support.blender import compat
from ..support.printer import emit
from . import graphics_cards


def main(arguments: list[str]) -> int:
    """Print version and abilities, and end the process, since the Blender module may hang when it ends."""
    emit(
        "probe",
        blender=bpy.app.version_string,
        python=platform.python_version(),
        osl=compat.has_osl(),
        denoiser=compat.has_oidn(),
        devices=graphics_cards.select_cards(),
        module=not bpy.app.binary_path,
    )
    sys.stdout.flush()
    os._exit(0)
