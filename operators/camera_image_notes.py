"""Notes on camera images in the header of an Image Editor: how an image is shown, and why it is dark.

A note is stored with its image, so that it is in a saved file too.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..stereo.pair_views import describe_darkness
from ..support.arrays import Array
from ..support.srgb import to_srgb

#: Camera images are shown as matchers get them; a stretch would hide how dark they are.
AS_RECORDED = "as recorded, not stretched"
_NOTE = "icymoon_note"
_MAX_CHARACTERS = 120


def name_camera_image(pair: str, eye: str) -> str:
    """Return the name of the image of a pair's ``eye``, left or right."""
    return f"{eye.title()} Camera, Pair {pair}"


def note_camera_image(image: bpy.types.Image) -> None:
    """Store a note with a loaded camera image: how the image is shown and, if most of it is dark, why."""
    dark = describe_darkness(_read_levels(image)) if len(image.pixels) else ""
    image[_NOTE] = "; ".join([AS_RECORDED.capitalize(), *filter(None, [dark])])


def read_note(image: bpy.types.Image) -> str:
    """Read the note of an image; empty without a note. Long notes are cut and other types ignored, because anyone may
    have made the file."""
    note = image.get(_NOTE)
    return note[:_MAX_CHARACTERS] if isinstance(note, str) else ""


def _read_levels(image: bpy.types.Image) -> Array:
    """Read the levels (n,) of an image's pixels: the mean of their colours as a screen shows them, from 0 to 1."""
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    levels = values.reshape(-1, image.channels)[:, : min(3, image.channels)].mean(axis=1)
    return to_srgb(levels) if image.is_float else levels  # Blender stores an image of 16 bits as linear light
