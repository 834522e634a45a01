"""The user's preferences on this machine, which no scene contains."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import bpy

from ..commands.doctor import Finding
from ..formats import asset_library
from ..settings import change_announcements
from ..settings.topics import trust_boundary
from ..stereo.environment.packages import PACKAGES
from ..stereo.matchers import list_set_ups
from ..support import bundled_wheels, cache_folder
from ..support.errors import IcyMoonError
from ..support.files import parse_path
from ..support.system import find_venv_python
from ..support.version import ROOT
from .session import session

#: Packages that the evaluator's Python needs, as shown to the user.
_NEEDED_PACKAGES = ", ".join(name for name, *_ in PACKAGES.values())

#: The name by which Blender knows the add-on: the package that contains this folder.
ADD_ON = __package__.rpartition(".")[0]
#: The name of our asset library in the Asset Browser, until the user renames it.
ASSET_LIBRARY = "Icy Moon"


def find_extension_folder(create: bool = True) -> Path:
    """Return the extension's own folder, which upgrades keep. ``create`` makes it if it does not exist.

    Raises IcyMoonError if Icy Moon is not an installed extension.
    """
    try:
        return Path(bpy.utils.extension_path_user(ADD_ON, create=create))
    except ValueError:
        raise IcyMoonError(
            "Icy Moon does not run as an installed extension; set ICYMOON_EVALUATOR to the evaluator's Python."
        ) from None


def can_install_evaluator() -> bool:
    """Return whether this extension can install packages. A store build contains the packages and has no installer."""
    return (ROOT / "stereo" / "environment" / "install.py").is_file()


def find_own_evaluator_python() -> Path:
    """Return the path of the Python of the evaluator that the Install button installs."""
    return find_venv_python(find_extension_folder() / "evaluator")


def has_own_evaluator() -> bool:
    """Return whether the Install button has completely installed an evaluator."""
    if not can_install_evaluator():
        return False
    from ..stereo.environment.install import is_unfinished

    try:
        own = find_own_evaluator_python()
    except IcyMoonError:  # not installed as an extension
        return False
    return own.is_file() and not is_unfinished(own.parents[1])


def find_asset_folder() -> Path:
    """Return the folder of the asset library. Raises IcyMoonError if the extension has no folder."""
    return find_extension_folder(create=False) / "assets"


def has_assets() -> bool:
    """Return whether a complete asset library exists."""
    try:
        return asset_library.has_library(find_asset_folder())
    except IcyMoonError:  # not installed as an extension
        return False


def find_asset_libraries() -> list[Any]:
    """Find the entries of Blender's preferences for our asset library, under any name."""
    try:
        folder = find_asset_folder()
    except IcyMoonError:
        return []
    return [
        each
        for each in bpy.context.preferences.filepaths.asset_libraries
        if each.path and not each.path.startswith("//") and Path(each.path) == folder
    ]


def list_asset_library() -> None:
    """Enter our asset library in Blender's preferences, unless it is listed."""
    if find_asset_libraries():
        return
    library = bpy.context.preferences.filepaths.asset_libraries.new(
        name=ASSET_LIBRARY, directory=str(find_asset_folder())
    )
    library.import_method = "APPEND"  # dropped assets can be edited; Blender 5 would pack them otherwise


def unlist_asset_library() -> None:
    """Remove our asset library from Blender's preferences; its files stay."""
    for library in find_asset_libraries():
        bpy.context.preferences.filepaths.asset_libraries.remove(library)


def get_preferences() -> bpy.types.AddonPreferences:
    """Return the preferences of the extension; None if Icy Moon does not run as an installed add-on."""
    add_on = bpy.context.preferences.addons.get(ADD_ON)
    return add_on.preferences if add_on else None


def find_evaluator_python() -> str:
    """Find the Python that evaluates.

    It is the first of these: the preference, ``ICYMOON_EVALUATOR``, this Python if Blender is a module of it, Blender's
    own Python with the wheels of a store build, the Python that the Install button installed. Raises IcyMoonError if
    none of these exists.
    """
    preferences = get_preferences()
    chosen = bpy.path.abspath(preferences.evaluator) if preferences and preferences.evaluator else ""
    for candidate, origin in (
        (chosen, "the preferences"),
        (os.environ.get("ICYMOON_EVALUATOR", ""), "ICYMOON_EVALUATOR"),
    ):
        if candidate:
            path = parse_path(candidate, f"The evaluator's Python, named by {origin},")
            if not path.is_file():
                raise IcyMoonError(
                    f"The evaluator's Python {path}, named by {origin}, does not exist; "
                    "correct the path or install the evaluator in the preferences."
                )
            return str(path)
    if not bpy.app.binary_path:
        return sys.executable
    if bundled_wheels.has_bundled_wheels() and (blenders := bundled_wheels.find_python()):
        return blenders
    if has_own_evaluator():
        return str(find_own_evaluator_python())
    raise IcyMoonError(_describe_how_to_get_evaluator())


def _describe_how_to_get_evaluator() -> str:
    """Describe in a sentence how to get an evaluator."""
    if not can_install_evaluator():
        return (
            "The Python of this Blender was not found as a program, or it lacks numpy, so it cannot evaluate; "
            f"choose a Python that has {_NEEDED_PACKAGES} in Preferences ▸ Add-ons ▸ Icy Moon, or name it by "
            "ICYMOON_EVALUATOR."
        )
    if bpy.app.background:
        return (
            'There is no evaluator yet; install it with blender --online-mode -b --python-expr "import bpy; '
            f'bpy.ops.icymoon.install_evaluator()", or set ICYMOON_EVALUATOR to a Python that has {_NEEDED_PACKAGES}.'
        )
    return (
        "There is no evaluator yet; open Preferences ▸ Add-ons ▸ Icy Moon and press Install Evaluator, or choose a "
        f"Python that has {_NEEDED_PACKAGES}."
    )


def is_evaluator_missing() -> bool:
    """Return whether no evaluator is installed or chosen, and the Install button can install one."""
    if not can_install_evaluator():
        return False
    try:
        find_extension_folder()
    except IcyMoonError:
        return False
    try:
        find_evaluator_python()
    except IcyMoonError:
        chosen = getattr(get_preferences(), "evaluator", "") or os.environ.get("ICYMOON_EVALUATOR", "")
        return not chosen  # the user must correct a wrong path
    return False


def count_workers() -> int:
    """Return the number of processes that render a data set whose ``dataset.workers`` is 0; 0 for the machine's
    default."""
    preferences = get_preferences()
    return int(preferences.workers) if preferences else 0


def find_kernels() -> str:
    """Return the meta-kernel or folder of SPICE kernels for scenes that name none; empty if the user has chosen
    none."""
    preferences = get_preferences()
    return bpy.path.abspath(preferences.kernels) if preferences and preferences.kernels else ""


def list_own_matchers() -> list[str]:
    """List the names of the user's own matchers on this machine."""
    preferences = get_preferences()
    return [item.name for item in preferences.matchers] if preferences else []


def list_plugin_matchers() -> list[str]:
    """List the names of the plug-ins' matchers that the last Check found in the evaluator's Python."""
    preferences = get_preferences()
    return preferences.plugin_matchers.split() if preferences else list(_found_matchers)


def make_own_matcher_arguments(methods: str) -> list[str]:
    """Make the evaluator's arguments for the user's own matchers in a list of matchers.

    Raises IcyMoonError if a matcher is not set up on this machine.
    """
    preferences = get_preferences()
    known = {item.name: item for item in preferences.matchers} if preferences else {}
    arguments = []
    for name in trust_boundary.list_own_names(methods):
        if name not in known:
            raise IcyMoonError(
                f"The matcher {trust_boundary.OWN_PREFIX}:{name} is not set up on this machine; add it under "
                "Own Matchers in the preferences of Icy Moon, or leave it out."
            )
        arguments += [word for text in _make_matcher_texts(known[name]) for word in ("--own", text)]
    return arguments


def _make_matcher_texts(item: bpy.types.PropertyGroup) -> list[str]:
    """Make the text ``NAME:METHOD:KEY=VALUE`` for each option of one of the user's matchers."""
    options = [f"{dict(list_set_ups())[item.method][1]}={item.program}"] if item.program else []
    options += [option for option in item.options.split(":") if option.strip()]
    return [f"{item.name}:{item.method}:{option}" for option in options] or [f"{item.name}:{item.method}"]


def _choose_cache(preferences: bpy.types.AddonPreferences, context: bpy.types.Context) -> None:
    cache_folder.choose_folder(bpy.path.abspath(preferences.cache) if preferences and preferences.cache else "")


#: Plug-ins' matchers that the last Check found, for use without preferences that could keep them.
_found_matchers: list[str] = []
#: Findings of the last Check in this session, which the preferences show.
findings: list[Finding] = []
_ICON_BY_STATUS = {"ok": "CHECKMARK", "limited": "INFO", "missing": "ERROR"}


class ICYMOON_PG_matcher(bpy.types.PropertyGroup):
    """One of the user's own matchers, which scenes name as own:NAME"""

    name: bpy.props.StringProperty(
        name="Name", description="Name with letters, digits, - and _. A scene names the matcher as own:NAME"
    )
    method: bpy.props.EnumProperty(
        name="Kind",
        description="Kind of matcher",
        items=tuple((name, label, about, "NONE", number) for name, (number, _, label, about) in list_set_ups()),
    )
    program: bpy.props.StringProperty(
        name="Command or File",
        description="For a program, its command, with {left}, {right} and {out} if it is started for each pair. For a "
        "network, its ONNX or checkpoint file. For stereo-matching, the Python that has the package",
    )
    options: bpy.props.StringProperty(
        name="Options",
        description="Other options, separated by colons, such as format=pfm:timeout_s=60 or model=raft-stereo",
    )


class ICYMOON_AP_preferences(bpy.types.AddonPreferences):
    """Preferences of Icy Moon"""

    bl_idname = ADD_ON

    evaluator: bpy.props.StringProperty(
        name="Evaluator's Python",
        subtype="FILE_PATH",
        default="",
        description=f"Python that evaluates pairs, with {_NEEDED_PACKAGES}. "
        "Empty for the one that comes with the extension or that Install Evaluator installs",
    )
    kernels: bpy.props.StringProperty(
        name="SPICE Kernels",
        subtype="FILE_PATH",
        default="",
        description="A meta-kernel, or a folder of kernels, for scenes that take their sky positions from SPICE "
        "kernels and name no kernels",
    )
    cache: bpy.props.StringProperty(
        name="Cache",
        subtype="DIR_PATH",
        default="",
        update=_choose_cache,
        description="Folder for the measured speed of this machine and for stand-ins that were made. Empty for "
        "your user cache, which the command line uses too",
    )
    workers: bpy.props.IntProperty(
        name="Workers",
        min=0,
        max=1024,
        soft_max=16,
        default=0,
        description="Number of processes that render a data set whose own number is 0. Each needs one to two gigabytes "
        "of memory; 0 for one for each four processors",
    )
    tab_was_opened: bpy.props.BoolProperty(
        name="Tab Was Opened",
        options={"HIDDEN"},
        description="Whether the tab in the sidebar was opened after the installation",
    )
    plugin_matchers: bpy.props.StringProperty(
        name="Matchers of Plug-Ins",
        options={"HIDDEN"},
        description="Packages that the last Check found in the evaluator's Python",
    )
    matchers: bpy.props.CollectionProperty(
        type=ICYMOON_PG_matcher,
        name="Own Matchers",
        description="Your own programs and networks. For security, scenes and files cannot contain them",
    )

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        _draw_top(layout)
        row = layout.row()  # at the top, where it is visible without scrolling
        row.operator("icymoon.check_evaluator", icon="CHECKMARK")
        there = has_own_evaluator()
        if can_install_evaluator():
            row.operator(
                "icymoon.install_evaluator", text="Reinstall Evaluator" if there else "Install Evaluator", icon="IMPORT"
            )
        if there:
            row.operator("icymoon.remove_evaluator", text="Remove Evaluator", icon="TRASH")
            layout.label(
                text=f"The evaluator is installed in {find_own_evaluator_python().parents[1]}", icon="CHECKMARK"
            )
        if bundled_wheels.has_bundled_wheels():
            layout.label(
                text="The evaluator is part of the extension; only networks need a Python of their own",
                icon="CHECKMARK",
            )
        for finding in findings:
            column = layout.column(align=True)
            column.label(text=f"{finding.subject}: {finding.fact}", icon=_ICON_BY_STATUS[finding.state])
            if finding.fix:
                column.label(text=finding.fix, icon="BLANK1")
        row = layout.row()
        row.operator(
            "icymoon.make_asset_library",
            icon="ASSET_MANAGER",
            text="Make Asset Library Again" if has_assets() else "Make Asset Library",
        )
        if has_assets() or find_asset_libraries():
            row.operator("icymoon.remove_asset_library", text="Remove Asset Library", icon="TRASH")
        layout.prop(self, "evaluator")
        layout.prop(self, "kernels")
        layout.prop(self, "cache")
        layout.prop(self, "workers")
        _draw_matchers(layout, self.matchers)


def _draw_top(layout: bpy.types.UILayout) -> None:
    """Draw the progress of the running job and the button that stops it; without a job, a line that tells where the
    sidebar is. Either takes one line, so that no button moves."""
    row = layout.row(align=True)
    if session.job is None:
        row.label(text="Icy Moon is a tab in the sidebar of the 3D View, which N opens", icon="INFO")
        return
    row = row.split(factor=0.85, align=True)
    row.progress(factor=session.job.fraction, text=session.job.brief)
    row.operator("icymoon.cancel", icon="X")


def _draw_matchers(layout: bpy.types.UILayout, matchers: bpy.types.bpy_prop_collection) -> None:
    row = layout.row()
    row.label(text="Own Matchers")
    row.operator("icymoon.add_matcher", icon="ADD")
    for index, item in enumerate(matchers):
        box = layout.box()
        row = box.row()
        row.prop(item, "name")
        row.operator("icymoon.remove_matcher", text="", icon="X").index = index
        for key in ("method", "program", "options"):
            box.prop(item, key)


def get_matchers() -> bpy.types.bpy_prop_collection:
    """Return the list of the user's own matchers. Raises IcyMoonError if the add-on has no preferences."""
    preferences = get_preferences()
    if preferences is None:
        raise IcyMoonError(
            "Icy Moon does not run as an installed add-on, so it has no preferences; name your matcher "
            "on the command line."
        )
    return preferences.matchers


def show_findings(found: list[Finding]) -> None:
    """Show the findings of a check in the preferences, and keep the names of the plug-ins' matchers among them."""
    findings[:] = found
    if any(finding.subject == "Evaluator" for finding in found):
        _found_matchers[:] = [name for finding in found for name in finding.names]
        if preferences := get_preferences():
            preferences.plugin_matchers = " ".join(_found_matchers)


def register() -> None:
    """Register the preferences, and list the asset library. From now on, scenes that need kernels but name none get the
    preferred kernels."""
    bundled_wheels.share_wheels(Path(bpy.utils.user_resource("EXTENSIONS")))
    bpy.utils.register_class(ICYMOON_PG_matcher)
    bpy.utils.register_class(ICYMOON_AP_preferences)
    change_announcements.listeners.append(_give_kernels)
    if has_assets():  # made before the extension was disabled or updated
        list_asset_library()
    _choose_cache(get_preferences(), bpy.context)


def _give_kernels(scene: bpy.types.Scene, effects: frozenset[str]) -> None:
    light = scene.icymoon.light
    if "light" in effects and light.directions_from == "KERNELS" and not light.kernels and find_kernels():
        light.kernels = find_kernels()


def unregister() -> None:
    """Unregister the preferences, and take the asset library off Blender's list."""
    change_announcements.listeners.remove(_give_kernels)
    unlist_asset_library()  # Blender deletes its folder with the extension
    cache_folder.choose_folder("")
    findings.clear()
    _found_matchers.clear()
    bpy.utils.unregister_class(ICYMOON_AP_preferences)
    bpy.utils.unregister_class(ICYMOON_PG_matcher)
    bundled_wheels.unshare_wheels()
