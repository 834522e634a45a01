"""Read Calibration and Write Calibration: the rig of a scene from the files of other programs, and back."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

import bpy

from ..commands.calibrated_eyes import complete_eyes
from ..commands.camera import parse_sizes, read_eyes, read_rig
from ..formats.calibrations.options import UNITS_M, Stated
from ..formats.calibrations.registry import FORMATS, write_calibration
from ..physics.camera.rig_cameras import make_calibrated_rig
from ..settings.blender import scene_properties
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.printer import show_controls
from . import dialogs
from .sidebar_text import format_for_window

#: Choice of the value that the file states.
_FILE = "FILE"
_FORMATS = [(name, kind.title, f"Files of {kind.title}") for name, kind in FORMATS.items()]
_LABELS = {"--unit": "Unit", "--size": "Image Size", "--lens": "Lens", "--cameras": "Cameras", "--format": "Format"}
_NAMES = ("left", "right")


def _translate_error(error: IcyMoonError) -> str:
    """Replace the options in an error's sentence by the labels of this dialog."""
    text = str(error).replace("give it first", "tick Exchange Files")
    return format_for_window(re.sub("|".join(_LABELS), lambda found: _LABELS[found[0]], text))


def list_calibration_files(path: Path, name: str) -> list[Path]:
    """List the paths of a pair's calibration files in a format, named after ``path``: one file for each eye, or one for
    both."""
    kind = FORMATS[name]
    if not kind.suffix:
        return [path.with_suffix("")]
    whole = path.with_suffix(kind.suffix)
    return [whole.with_stem(f"{whole.stem}_{eye}") for eye in _NAMES] if kind.each else [whole]


class ICYMOON_OT_read_calibration(dialogs.FileDialog, bpy.types.Operator):
    """Set the stereo camera to a calibrated pair, from files of OpenCV, ROS, Kalibr, mrcal, JPL, COLMAP or nerfstudio. Choose one file, or one for each eye"""  # noqa: E501

    bl_idname = "icymoon.read_calibration"
    bl_label = "Read Calibration"
    bl_options = {"REGISTER", "UNDO"}

    filepath: dialogs.file_property("Calibration to read")
    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    kind: bpy.props.EnumProperty(
        name="Format",
        description="Format of the files",
        items=[(_FILE, "Detected from the Files", "The format is detected from the files"), *_FORMATS],
    )
    unit: bpy.props.EnumProperty(
        name="Unit",
        description="Unit of lengths, where the files leave it open",
        items=[
            (_FILE, "As in the File", "The unit that the file states"),
            *((unit, unit, f"Lengths are in {unit}") for unit in UNITS_M),
        ],
    )
    size: bpy.props.StringProperty(
        name="Image Size",
        description="Width and height of the images in px where the files leave it open, as 640x480, or "
        "640x480,1280x960 for two sizes",
    )
    lens: bpy.props.EnumProperty(
        name="Lens",
        description="Lens of four coefficients in files of OpenCV",
        items=[
            (_FILE, "As in the File", "The lens that the file states"),
            ("brown", "Brown-Conrady", "k1, k2, p1, p2"),
            ("fisheye", "Fisheye", "Kannala and Brandt"),
        ],
    )
    cameras: bpy.props.StringProperty(name="Cameras", description="Names of two cameras of a file, as cam0,cam2")
    exchange: bpy.props.BoolProperty(name="Exchange Files", description="The second file is the left eye")
    alike: bpy.props.BoolProperty(
        name="Both Eyes Alike",
        description="Mean of both cameras, or the camera of the rectified images, in place of two that differ",
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            found, notes = self._read(self._list_files())
            scene_properties.write_settings(context.scene.icymoon, complete_eyes(found))
        except IcyMoonError as error:
            self.report({"ERROR"}, _translate_error(error))
            return {"CANCELLED"}
        for note in notes:
            self.report({"INFO"}, format_for_window(note))
        return {"FINISHED"}

    def _list_files(self) -> list[Path]:
        names = [each.name for each in self.files if each.name]
        chosen = [str(Path(self.directory) / name) for name in names] or [self.filepath]
        paths = [Path(bpy.path.abspath(path)) for path in chosen]
        return paths[::-1] if self.exchange else paths

    def _read(self, paths: Sequence[Path]) -> tuple[Settings, list[str]]:
        try:
            sizes = parse_sizes(self.size) if self.size else ()
        except argparse.ArgumentTypeError as error:
            raise IcyMoonError(f"Image Size: {error}.") from None
        unit, lens, kind = (None if value == _FILE else value for value in (self.unit, self.lens, self.kind))
        read = read_rig if self.alike else read_eyes
        return read(*paths, stated=Stated(unit, sizes, lens), kind=kind, names=self.cameras or None)


class ICYMOON_OT_write_calibration(dialogs.FileDialog, bpy.types.Operator):
    """Write the calibration of the stereo camera for OpenCV, ROS, Kalibr, mrcal, JPL, COLMAP or nerfstudio. Formats with a file for each eye get two"""  # noqa: E501

    bl_idname = "icymoon.write_calibration"
    bl_label = "Write Calibration"

    filepath: dialogs.file_property("Calibration to write, or the folder of COLMAP's")
    kind: bpy.props.EnumProperty(name="Format", description="Format to write", items=_FORMATS)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.filepath = self.filepath or "rig"
        return super().invoke(context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            paths = list_calibration_files(Path(bpy.path.abspath(self.filepath)), self.kind)
            settings = scene_properties.read_settings(context.scene.icymoon)
            _write_calibration_files(settings, paths, self.kind)
        except IcyMoonError as error:
            self.report({"ERROR"}, _translate_error(error))
            return {"CANCELLED"}
        self.report({"INFO"}, show_controls(f"Saved {' and '.join(map(str, paths))}"))
        return {"FINISHED"}


def _write_calibration_files(settings: Settings, paths: Sequence[Path], kind: str) -> None:
    try:
        rig = make_calibrated_rig(settings)
    except ValueError as error:
        raise IcyMoonError(f"The eyes' settings make no valid cameras: {error}; correct their lenses.") from None
    write_calibration(rig, paths, kind)


CLASSES = (ICYMOON_OT_read_calibration, ICYMOON_OT_write_calibration)
