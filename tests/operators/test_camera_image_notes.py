"""Camera images in an Image Editor: their names, and the words in the header on how they are shown."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from icymoon.formats.png import encode_png
from icymoon.operators import camera_image_notes, image_editor, results, show_camera_image
from icymoon.panels import pair_views
from panel_drawing import Layout, texts
from stand_ins import stand_in

ID = "0123456789ab"


def write_image(path, dark_share, bits=8):
    """A grey image, whose upper rows are nearly black and the others light."""
    top = 2**bits - 1
    image = np.full((40, 64), 0.6 * top, np.uint8 if bits == 8 else np.uint16)
    image[: round(40 * dark_share)] = 0.03 * top
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(encode_png(image, 0))
    return path


def header_of(image) -> str:
    layout = Layout()
    context = SimpleNamespace(scene=bpy.context.scene, space_data=SimpleNamespace(image=image))
    pair_views._draw_header(SimpleNamespace(layout=layout), context)
    return texts(layout.record)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize(("share", "told"), [(0.25, ""), (0.75, "; 75 % dark: shadow or sky")])
def test_the_note_tells_how_an_image_is_shown_and_why_it_is_dark(scene, tmp_path, bits, share, told):
    image = bpy.data.images.load(str(write_image(tmp_path / "left.png", share, bits)))
    assert camera_image_notes.read_note(image) == ""
    assert header_of(image) == ""
    camera_image_notes.note_camera_image(image)
    assert camera_image_notes.read_note(image) == f"As recorded, not stretched{told}"
    assert camera_image_notes.read_note(image) in header_of(image)


def test_a_note_of_a_foreign_file_is_a_short_text_or_none(scene):
    image = bpy.data.images.new("Any", 4, 4)
    for stored, read in (("x" * 1000, 120), ([1, 2], 0), (3, 0)):
        image["icymoon_note"] = stored
        assert len(camera_image_notes.read_note(image)) == read


def test_an_image_without_pixels_has_no_cause(scene, tmp_path):
    image = bpy.data.images.load(str(write_image(tmp_path / "left.png", 1.0)))
    (tmp_path / "left.png").unlink()
    image.reload()
    camera_image_notes.note_camera_image(image)
    assert camera_image_notes.read_note(image) == "As recorded, not stretched"


def test_both_camera_images_are_named_by_camera_and_pair(scene, tmp_path, monkeypatch):
    folder = tmp_path / "exposed" / ID
    for eye in ("left", "right"):
        write_image(folder / f"{eye}.png", 0.75)
    area = SimpleNamespace(spaces=SimpleNamespace(active=SimpleNamespace(image=None)))
    monkeypatch.setattr(results, "bpy", SimpleNamespace(app=SimpleNamespace(background=False), data=bpy.data))
    monkeypatch.setattr(image_editor, "show_in_editor", lambda open_window, show: show(area) or True)
    monkeypatch.setattr(image_editor, "zoom_to_fit", lambda area: None)
    monkeypatch.setattr(results, "push_undo", lambda name: None)
    operator = stand_in(_job=SimpleNamespace(result={"folders": [str(folder)]}), report=lambda *_: None)
    show_camera_image.ICYMOON_OT_expose.report_success(operator, bpy.context)
    assert area.spaces.active.image.name == f"Left Camera, Pair {ID}"
    assert {f"{eye} Camera, Pair {ID}" for eye in ("Left", "Right")} <= {image.name for image in bpy.data.images}
    assert "75 % dark" in header_of(area.spaces.active.image)
