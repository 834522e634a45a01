"""Show the picture of a chosen scene in its camera's frame, until the view itself has traced some light.

Cycles shows its first picture with the ground at full resolution after some seconds; on two processors without a
graphics card, this picture is grainy for a minute. The picture by which the scene was chosen shows the same ground and
light. It is drawn over the view, so no image is added to the file. A changed setting removes the picture.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import bpy.utils.previews
import gpu
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d

from ..nodes import build_scene as scenes
from ..support.blender import compat
from ..support.srgb import from_srgb
from .window_areas import redraw

#: Draws of the view, with the fine ground, until the picture is removed. The view is drawn once for a light path of
#: each pixel, and more often if the mouse moves.
_DRAWS_BEFORE_REMOVAL = 8


class FirstPicture:
    """The picture, if any, that is drawn over the view of a scene."""

    def __init__(self) -> None:
        self._scene_name = ""
        self._left: int | None = None  # number of draws that remain; None until the fine ground exists
        self._texture: Any = None
        self._handler: object = None

    def show(self, scene: bpy.types.Scene, path: Path) -> None:
        """Draw a picture over the view of a built scene, if a window and the picture's file exist."""
        self.remove()
        if not bpy.app.background and path.is_file() and scenes.find_collection(scene) is not None:
            self._scene_name, self._left, self._texture = scene.name, None, _read_texture(path)
            self._handler = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", "POST_PIXEL")

    def count(self, scene: bpy.types.Scene) -> None:
        """Count draws from now on, because the view shows its final ground; the last one removes the picture."""
        if self.is_shown(scene) and self._left is None:
            self._left = _DRAWS_BEFORE_REMOVAL

    def is_shown(self, scene: bpy.types.Scene) -> bool:
        """Return whether a picture covers the view of a scene."""
        return self._handler is not None and self._scene_name == scene.name

    def remove(self) -> None:
        """Remove the picture, if there is one."""
        if self._handler is not None:
            bpy.types.SpaceView3D.draw_handler_remove(self._handler, "WINDOW")
            self._handler = self._texture = None
            redraw("VIEW_3D")

    def _draw(self) -> None:
        context = bpy.context
        place = _find_frame(context) if self.is_shown(context.scene) else None
        if place is None:
            return
        x, y, width, height = place
        across, up = self._texture.width, self._texture.height
        scale = min(width / across, height / up)
        gpu.state.blend_set("NONE")
        compat.draw_linear_texture(
            self._texture, x + (width - scale * across) / 2, y + (height - scale * up) / 2, scale * across, scale * up
        )
        if self._left is not None:
            self._left -= 1
            if self._left == 0:
                bpy.app.timers.register(self.remove, first_interval=0.0)  # not while Blender calls its handlers


def _read_texture(path: Path) -> gpu.types.GPUTexture:
    """Read a picture of at most 256 columns and rows as a texture in linear light."""
    pictures = bpy.utils.previews.new()
    try:
        found = pictures.load(path.name, str(path), "IMAGE")
        shown = np.array(found.image_pixels_float, np.float32).reshape(-1, 4)
        light = from_srgb(shown)
        light[:, 3] = 1.0
        values = gpu.types.Buffer("FLOAT", light.size, light.ravel().tolist())
        return gpu.types.GPUTexture(tuple(found.image_size), format="RGBA16F", data=values)
    finally:
        bpy.utils.previews.remove(pictures)


def _find_frame(context: bpy.types.Context) -> tuple[float, float, float, float] | None:
    """Find the camera's frame in a 3D View, in px: left, bottom, width and height. None unless the view shows rendered
    light and looks through a camera."""
    space: bpy.types.Space = context.space_data
    view = context.region_data
    camera = space.camera if space.use_local_camera else context.scene.camera
    if (
        view is None
        or view.view_perspective != "CAMERA"
        or space.shading.type != "RENDERED"
        or camera is None
        or camera.type != "CAMERA"
    ):
        return None
    corners = [
        location_3d_to_region_2d(context.region, view, camera.matrix_world @ corner)
        for corner in camera.data.view_frame(scene=context.scene)
    ]
    if any(corner is None for corner in corners):
        return None
    x, y = (sorted(corner[axis] for corner in corners) for axis in (0, 1))
    return x[0], y[0], x[-1] - x[0], y[-1] - y[0]
