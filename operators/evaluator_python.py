"""Check the evaluator's Python, and list the user's own matchers."""

from __future__ import annotations

import sys
from dataclasses import replace

import bpy

from ..commands.doctor import Finding, examine_blender, examine_evaluator, examine_kernels, examine_landforms
from ..support.errors import IcyMoonError
from ..support.printer import show_controls
from .preferences import find_evaluator_python, find_kernels, get_matchers, show_findings
from .sidebar_text import format_for_window, replace_keys_by_labels


def collect_findings() -> list[Finding]:
    """Collect the findings of ``doctor`` on this Blender, the evaluator, the landforms and the preferred kernels."""
    try:
        found = examine_evaluator(find_evaluator_python())
    except IcyMoonError as error:
        found = [Finding("Evaluator", "missing", str(error).rstrip("."))]
    # Blender is examined in a separate process, since listing the graphics cards in Cycles also selects them.
    return [
        *found,
        *examine_landforms(),
        *examine_kernels(find_kernels()),
        *examine_blender(bpy.app.binary_path or sys.executable),
    ]


class ICYMOON_OT_check_evaluator(bpy.types.Operator):
    """Check Blender's abilities, the evaluator's packages and the SPICE kernels, and show how to fix problems. Takes some seconds"""  # noqa: E501

    bl_idname = "icymoon.check_evaluator"
    bl_label = "Check Evaluator"

    def execute(self, context: bpy.types.Context) -> set[str]:
        found = collect_findings()
        show_findings([replace(finding, fix=replace_keys_by_labels(finding.fix)) for finding in found])
        missing = next((finding for finding in found if finding.state == "missing"), None)
        if missing:
            self.report({"ERROR"}, format_for_window(f"{missing.subject}: {missing.fact}. {missing.fix}".strip()))
            return {"CANCELLED"}
        self.report({"INFO"}, show_controls(f"Ready: {', '.join(f.subject for f in found if f.state == 'ok')}"))
        return {"FINISHED"}


class ICYMOON_OT_add_matcher(bpy.types.Operator):
    """Add your own program or network as a matcher, which scenes name as own:NAME"""

    bl_idname = "icymoon.add_matcher"
    bl_label = "Add Matcher"

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            known = get_matchers()
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        names = {item.name for item in known}
        item = known.add()
        item.name = next(name for k in range(len(names) + 1) if (name := f"mine{k or ''}") not in names)
        context.preferences.is_dirty = True
        return {"FINISHED"}


class ICYMOON_OT_remove_matcher(bpy.types.Operator):
    """Remove this matcher from the preferences. Its program or file is not deleted"""

    bl_idname = "icymoon.remove_matcher"
    bl_label = "Remove Matcher"

    index: bpy.props.IntProperty(name="Index", min=0, description="Index of the matcher")

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            get_matchers().remove(self.index)
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        context.preferences.is_dirty = True
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_check_evaluator, ICYMOON_OT_add_matcher, ICYMOON_OT_remove_matcher)
