"""What belongs to the person and the machine, not to a scene."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import bpy

from .errors import IcyMoonError
from .stereo.check import PACKAGES

#: What the evaluator's Python needs, for people to read.
_NEEDED = ", ".join(name for name, _ in PACKAGES.values())


def extension_folder() -> Path:
    """A folder of the extension's own that survives its upgrades. Raises IcyMoonError if there is none."""
    try:
        return Path(bpy.utils.extension_path_user(__package__, create=True))
    except ValueError:
        raise IcyMoonError("Icy Moon does not run as an installed extension; give the evaluator's Python by "
                           "ICYMOON_EVALUATOR.") from None


def own_evaluator() -> Path:
    """The Python of the evaluator that the Install button makes."""
    return extension_folder() / "evaluator" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def _preferences() -> Any:
    add_on = bpy.context.preferences.addons.get(__package__)
    return add_on.preferences if add_on else None


def evaluator_python() -> str:
    """Path of the Python that evaluates: the preference, ``ICYMOON_EVALUATOR``, the one that the
    Install button made, or this Python where Blender is itself a module of it.

    Raises IcyMoonError if there is none.
    """
    preferences = _preferences()
    chosen = bpy.path.abspath(preferences.evaluator) if preferences and preferences.evaluator else ""
    for candidate, origin in ((chosen, "the preferences"), (os.environ.get("ICYMOON_EVALUATOR", ""),
                                                            "ICYMOON_EVALUATOR")):
        if candidate:
            path = Path(os.path.expanduser(candidate))
            if not path.is_file():
                raise IcyMoonError(f"The evaluator's Python {path}, named by {origin}, is not there; "
                                   "correct the path or install the evaluator in the preferences.")
            return str(path)
    if not bpy.app.binary_path:
        return sys.executable
    if own_evaluator().is_file():
        return str(own_evaluator())
    raise IcyMoonError("There is no evaluator yet; open Preferences > Add-ons > Icy Moon and press Install, or give "
                       f"a Python that has {_NEEDED}.")


class ICYMOON_AP_preferences(bpy.types.AddonPreferences):
    """Preferences of Icy Moon"""

    bl_idname = __package__

    evaluator: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Evaluator's Python", subtype="FILE_PATH", default="",
        description=f"Python that measures the pairs, with {_NEEDED}; empty for the one that Install makes")
    finding: bpy.props.StringProperty(  # type: ignore[valid-type]
        options={"SKIP_SAVE", "HIDDEN"}, description="What the last check found")

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.prop(self, "evaluator")
        row = layout.row()
        row.operator("icymoon.check_evaluator", icon="CHECKMARK")
        row.operator("icymoon.install_evaluator", icon="IMPORT")
        if self.finding:
            layout.label(text=self.finding)


def remember(finding: str) -> None:
    """Show what a check found in the preferences."""
    preferences = _preferences()
    if preferences:
        preferences.finding = finding


def register() -> None:
    """Register the preferences."""
    bpy.utils.register_class(ICYMOON_AP_preferences)


def unregister() -> None:
    """Unregister the preferences."""
    bpy.utils.unregister_class(ICYMOON_AP_preferences)
