"""Paint the masks of rocks, dirt and frost: in Blender's Weight Paint mode, or on an image."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy
import numpy as np

from ..formats.png import encode_png
from ..library.inputs import Input
from ..nodes import build_scene as scenes
from ..nodes.datablocks.blend_file_paths import find_used_files
from ..nodes.ground import mask_sheet
from ..physics.rocks.painted_mask import MASK_SETTINGS, read_mask
from ..settings.blender import scene_properties
from ..settings.description import merged
from ..settings.table import TOPICS
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from . import refine_ground
from .build import leave_edit_mode
from .change_and_build import ChangeAndBuildOperator
from .job_operators import WatchingOperator
from .object_as_ground import shorten_path
from .render import find_dataset_folder
from .session import session
from .sidebar_text import format_for_window

KINDS = (
    ("ROCKS", "Rocks", "Where rocks lie"),
    ("DIRT", "Dirt", "Where dirt lies, of that on slopes and in troughs"),
    ("FROST", "Frost", "Where frost lies"),
)
#: (topic, key, value) of the amount that a first mask sets if the amount was 0.
_FIRST_AMOUNTS = {"ROCKS": ("rocks", "coverage", 0.05), "FROST": ("surface", "frost_share", 0.5)}
_MOST = 65535  # the largest value in the file
_NO_BRUSHES = (
    "This Blender was built without brushes, so it paints nothing; choose an image as the mask, or use the Blender of "
    "blender.org"
)


def name_group(kind: str) -> str:
    """Return the name of the vertex group of a kind of mask."""
    return f"Icy Moon {kind.title()}"


def can_use(scene: bpy.types.Scene, kind: str) -> bool:
    """Return whether a mask of a kind was painted in Weight Paint mode."""
    sheet = mask_sheet.find_sheet(scene)
    return sheet is not None and name_group(kind) in sheet.vertex_groups


def has_mask(scene: bpy.types.Scene, kind: str) -> bool:
    """Return whether the settings of a scene name a mask of a kind."""
    topic, key = MASK_SETTINGS[kind.lower()]
    return bool(getattr(getattr(scene.icymoon, topic), key))


def find_painted_kind(context: bpy.types.Context) -> str:
    """Find the kind of the mask that is being painted in Weight Paint mode; empty if none is."""
    sheet = mask_sheet.find_sheet(context.scene)
    if sheet is None or context.mode != "PAINT_WEIGHT" or context.object is not sheet:
        return ""
    active = sheet.vertex_groups.active
    return next((kind for kind, _, _ in KINDS if active is not None and active.name == name_group(kind)), "")


def leave_sheet(context: bpy.types.Context) -> None:
    """End the painting of a mask and hide its sheet, if the scene has one. The painted weights stay."""
    sheet = mask_sheet.find_sheet(context.scene)
    if sheet is None:
        return
    if context.object is sheet:
        leave_edit_mode()
    if sheet.visible_get():
        _hide_sheet(context, sheet)


class _MaskOperator(ChangeAndBuildOperator):
    """Mix-in: an operator on the mask of one kind. In a window it builds the scene in pieces."""

    bl_options = {"REGISTER", "UNDO"}
    kind: bpy.props.EnumProperty(name="Mask", description="What the mask is of", items=KINDS)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return self.execute(context)

    def _change(self, context: bpy.types.Context, changes: Mapping[str, Mapping[str, Any]]) -> set[str]:
        """Change settings, and build the scene with them."""
        self.change_settings(context.scene, changes)
        return self._build(context)

    def _use(self, context: bpy.types.Context, shares: Array, text: str) -> set[str]:
        """Keep a mask (rows, columns), north first, in the data set, and build the scene with it."""
        group = context.scene.icymoon
        try:
            before = scene_properties.read_settings(group)
            image = encode_png(np.rint(np.clip(shares, 0.0, 1.0) * _MOST).astype(np.uint16))
            topic, key = MASK_SETTINGS[self.kind.lower()]
            path = Input(f"{topic}.{key}", image, ".png", text).store(find_dataset_folder(before))
            changes = self._make_changes(before, shorten_path(path, group.dataset.folder))
        except IcyMoonError as error:
            return self.fail(error)
        result = self._change(context, changes)
        if result != {"CANCELLED"}:
            self._warn_if_idle(merged(before, changes))
        return result

    def _build(self, context: bpy.types.Context) -> set[str]:
        """Build the scene. In a window the ground is coarse at first, and the ground at full resolution follows."""
        coarse = not bpy.app.background
        at_once = not coarse or self.options.is_repeat
        if not at_once:
            return WatchingOperator.invoke(self, context, None)
        result = self.build_at_once(context, coarse)
        if coarse:
            refine_ground.start_refining()
        return result

    def _make_changes(self, settings: Settings, path: str) -> dict[str, dict[str, Any]]:
        topic, key = MASK_SETTINGS[self.kind.lower()]
        changes: dict[str, dict[str, Any]] = {topic: {key: path}}
        if self.kind in _FIRST_AMOUNTS:
            of, amount, first = _FIRST_AMOUNTS[self.kind]
            changes[of][amount] = settings[of][amount] or first
        return changes

    def _warn_if_idle(self, settings: Settings) -> None:
        topic, key = MASK_SETTINGS[self.kind.lower()]
        if obstacles := TOPICS[topic].list_obstacles(key, settings):
            self.report({"WARNING"}, format_for_window(f"The mask has no effect yet; set {' or '.join(obstacles)}."))


class ICYMOON_OT_paint_mask(_MaskOperator, bpy.types.Operator):
    """Paint in Weight Paint mode where rocks, dirt or frost lie: red is all of them, blue and black are none. Then press Use Painted Mask"""  # noqa: E501

    bl_idname = "icymoon.paint_mask"
    bl_label = "Paint Mask"

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "" if scenes.find_built(context.scene) else "Build the scene first"

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene, built = context.scene, scenes.find_built(context.scene)
        assert built is not None  # by poll
        leave_edit_mode()
        try:
            sheet = mask_sheet.lay_sheet(scene, built.terrain, built.settings.terrain.size_m)
            mask_sheet.make_group(sheet, name_group(self.kind), self._read_present(scene))
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        _show_to_paint(context, sheet)
        bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
        if not bpy.app.background and context.tool_settings.weight_paint.brush is None:
            self.report({"WARNING"}, _NO_BRUSHES)
        verb = "lie" if self.kind == "ROCKS" else "lies"
        self.report({"INFO"}, f"Paint where {self.kind.lower()} {verb}, then press Use Painted Mask")
        return {"FINISHED"}

    def _read_present(self, scene: bpy.types.Scene) -> Array | None:
        used = find_used_files(scene_properties.read_settings(scene.icymoon))
        path = used.get(".".join(MASK_SETTINGS[self.kind.lower()]))
        return None if path is None else read_mask(path)


class ICYMOON_OT_use_painted_mask(_MaskOperator, bpy.types.Operator):
    """Build the scene with what was painted in Weight Paint mode. The mask is kept as an image in the data set folder, and pairs depend on it"""  # noqa: E501

    bl_idname = "icymoon.use_painted_mask"
    bl_label = "Use Painted Mask"

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "" if mask_sheet.find_sheet(context.scene) else "Press Paint Mask first"

    def execute(self, context: bpy.types.Context) -> set[str]:
        sheet = mask_sheet.find_sheet(context.scene)
        assert sheet is not None  # by poll
        if name_group(self.kind) not in sheet.vertex_groups:
            self.report({"ERROR"}, f"Nothing is painted for {self.kind.lower()}; press Paint Mask first.")
            return {"CANCELLED"}
        leave_edit_mode()
        shares = mask_sheet.read_shares(sheet, name_group(self.kind))
        if not shares.any():
            self.report({"WARNING"}, f"Nothing is painted, so {self.kind.lower()} will be nowhere")
        result = self._use(context, shares, sheet.name)
        if result != {"CANCELLED"}:
            _hide_sheet(context, sheet)
        return result


class ICYMOON_OT_use_image_as_mask(_MaskOperator, bpy.types.Operator):
    """Take an image of this file as the mask, such as one from Texture Paint: seen from above, north up, over the whole patch"""  # noqa: E501

    bl_idname = "icymoon.use_image_as_mask"
    bl_label = "Use Image as Mask"

    image: bpy.props.StringProperty(name="Image", description="Image of this file")

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return "" if any(image.size[0] for image in bpy.data.images) else "Open or paint an image first"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        shown = getattr(context.space_data, "image", None)
        self.image = shown.name if shown is not None else self.image
        return set(context.window_manager.invoke_props_dialog(self))

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.prop(self, "kind")
        self.layout.prop_search(self, "image", bpy.data, "images")

    def execute(self, context: bpy.types.Context) -> set[str]:
        image = bpy.data.images.get(self.image)
        if image is None or not image.size[0] or (not image.has_data and not image.pixels):
            self.report({"ERROR"}, "The image has no pixels; choose another one.")
            return {"CANCELLED"}
        shares = _read_grey(image)
        if not np.isfinite(shares).all() or shares.min() < 0 or shares.max() > 1:
            self.report({"WARNING"}, "The image has values outside 0 to 1, which count as 0 or 1")
        return self._use(context, np.nan_to_num(shares), image.name)


class ICYMOON_OT_clear_mask(_MaskOperator, bpy.types.Operator):
    """Let rocks, dirt or frost lie everywhere again, and remove what was painted. The image in the data set folder stays"""  # noqa: E501

    bl_idname = "icymoon.clear_mask"
    bl_label = "Clear Mask"

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        scene = context.scene
        found = any(has_mask(scene, kind) or can_use(scene, kind) for kind, _, _ in KINDS)
        return "" if found else "There is no mask"

    def execute(self, context: bpy.types.Context) -> set[str]:
        leave_edit_mode()
        if sheet := mask_sheet.find_sheet(context.scene):
            _hide_sheet(context, sheet)
            mask_sheet.remove_group(sheet, name_group(self.kind))
        if not has_mask(context.scene, self.kind):
            return {"FINISHED"}
        topic, key = MASK_SETTINGS[self.kind.lower()]
        return self._change(context, {topic: {key: ""}})


def _read_grey(image: bpy.types.Image) -> Array:
    """Read the mean of the colour bands of an image as stored: (rows, columns), north first."""
    columns, rows = image.size
    pixels = np.empty(columns * rows * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    colours = pixels.reshape(rows, columns, image.channels)[::-1, :, : 3 if image.channels >= 3 else 1]
    return np.asarray(colours.mean(axis=2, dtype=np.float64))


def _show_to_paint(context: bpy.types.Context, sheet: bpy.types.Object) -> None:
    """Make the sheet the active object, and show its weights in the 3D View with the button."""
    sheet.hide_set(False)
    for item in context.selected_objects:
        item.select_set(False)
    sheet.select_set(True)
    context.view_layer.objects.active = sheet
    if context.area is None or context.area.type != "VIEW_3D":
        return
    space: bpy.types.Space = context.space_data
    if space.local_view is not None:
        sheet.local_view_set(space, True)
    session.before_painting.setdefault(space.as_pointer(), (space.shading.type, space.overlay.show_overlays))
    space.shading.type, space.overlay.show_overlays = "SOLID", True


def _hide_sheet(context: bpy.types.Context, sheet: bpy.types.Object) -> None:
    """Hide the sheet, and restore the shading and overlays that this 3D View had before the painting."""
    sheet.hide_set(True)
    space: Any = context.space_data
    before = session.before_painting.pop(space.as_pointer(), None) if space is not None else None
    if before is not None:
        space.shading.type, space.overlay.show_overlays = before


CLASSES = (
    ICYMOON_OT_paint_mask,
    ICYMOON_OT_use_painted_mask,
    ICYMOON_OT_use_image_as_mask,
    ICYMOON_OT_clear_mask,
)
