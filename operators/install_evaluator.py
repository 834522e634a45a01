"""Install the evaluator's Python from the Internet, and remove it. A store build has no such button."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

from ..commands.doctor import Finding
from ..render.workers.job_commands import python_command
from ..render.workers.process import clean_environment
from ..stereo.environment.install import DISK_MB
from ..support.errors import IcyMoonError
from ..support.printer import show_controls
from ..support.system import find_pythons, is_python, remove_folder, run
from . import jobs
from .evaluate import SCOPES
from .job_operators import DialogJobOperator, JobOperator, find_running_job
from .operator_type import ExplainedOperator
from .preferences import find_own_evaluator_python, has_own_evaluator, show_findings

#: Width of the question before the installation, in pixels of a screen without scaling.
_DIALOG_PX = 400


def find_base_python() -> str:
    """Find Blender's Python, which can make a virtual environment. Raises IcyMoonError if Blender has none."""
    for candidate in (Path(sys.executable), *find_pythons(Path(sys.prefix))):
        if is_python(str(candidate)) and candidate.is_file() and _can_make_environments(candidate):
            return str(candidate)
    raise IcyMoonError(
        "No Python that can make a virtual environment was found; install Python 3.11 or later with "
        "venv (on Debian and Ubuntu the package python3-venv), or choose a Python with the evaluator's "
        "packages in the preferences or by ICYMOON_EVALUATOR."
    )


def _can_make_environments(python: Path) -> bool:
    try:
        done = run([str(python), "-I", "-c", "import venv, ensurepip"], clean_environment(), timeout_s=30.0)
        return done.returncode == 0
    except OSError:  # for example, Windows' python.exe that only opens the Microsoft Store
        return False


class ICYMOON_OT_install_evaluator(DialogJobOperator, bpy.types.Operator):
    """Make a Python environment for the evaluator in the extension's folder, and install its packages from the Internet (450 MB on disk)"""  # noqa: E501

    bl_idname = "icymoon.install_evaluator"
    bl_label = "Install Evaluator"

    then_evaluate: bpy.props.EnumProperty(
        name="Then Evaluate",
        default="NOTHING",
        description="What to evaluate once the evaluator is installed",
        items=(("NOTHING", "Nothing", "Install only"), *SCOPES),
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Start the job. Ask first if the user has pressed Evaluate, or has not allowed online access yet."""
        if bpy.app.background or (self.then_evaluate == "NOTHING" and bpy.app.online_access):
            return JobOperator.invoke(self, context, event)
        return set(
            context.window_manager.invoke_props_dialog(
                self,
                width=_DIALOG_PX,
                title="Install the Evaluator?",
                confirm_text="Install" if self.then_evaluate == "NOTHING" else "Install and Evaluate",
            )
        )

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the question, and Blender's button for online access if access is off."""
        layout = self.layout
        layout.label(text=f"Evaluating needs packages from the Internet: {DISK_MB} MB on disk, once")
        if not bpy.app.online_access:
            layout.operator("extensions.userpref_allow_online", text="Allow Online Access", icon="CHECKMARK")

    def start(self, context: bpy.types.Context) -> jobs.Job:
        if not bpy.app.online_access:
            raise IcyMoonError(
                "Installing the evaluator needs online access; allow it in Preferences ▸ System ▸ Network."
            )
        folder = find_own_evaluator_python().parents[1]
        command = python_command(find_base_python(), "install", str(folder))
        return jobs.Job.start("Install", command)

    def report_success(self, context: bpy.types.Context) -> None:
        show_findings([Finding("Evaluator", "ok", "installed")])
        self.report({"INFO"}, "The evaluator is installed")
        if self.then_evaluate != "NOTHING":
            bpy.ops.icymoon.evaluate("INVOKE_DEFAULT", scope=self.then_evaluate)


class ICYMOON_OT_remove_evaluator(ExplainedOperator, bpy.types.Operator):
    """Delete the evaluator that Install Evaluator has installed in the extension's folder"""

    bl_idname = "icymoon.remove_evaluator"
    bl_label = "Remove Evaluator"

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        if not has_own_evaluator():
            return "No evaluator is installed in the extension's folder"
        return find_running_job()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return set(context.window_manager.invoke_confirm(self, event))

    def execute(self, context: bpy.types.Context) -> set[str]:
        folder = find_own_evaluator_python().parents[1]
        if not (folder / "pyvenv.cfg").is_file() or folder.is_symlink():
            self.report(
                {"ERROR"},
                show_controls(f"{folder} is not an environment that Install Evaluator made; remove it by hand."),
            )
            return {"CANCELLED"}
        remove_folder(folder)
        show_findings([])
        self.report({"INFO"}, show_controls(f"Removed {folder}"))
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_install_evaluator, ICYMOON_OT_remove_evaluator)
