"""Show Camera Image: the rendered pair through another camera response, from Blender."""

from __future__ import annotations

import json
import time
from pathlib import Path

import bpy
import numpy as np
import pytest
from icymoon.operators import jobs, live_exposure, live_preview
from icymoon.operators.session import session
from icymoon.panels import CLASSES
from panel_drawing import drawn


@pytest.mark.long
def test_the_rendered_pair_is_exposed_with_the_present_response(small, tmp_path):
    with pytest.raises(RuntimeError, match="press Render Stereo Pair"):
        bpy.ops.icymoon.expose()
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    assert bpy.ops.icymoon.render_pair() == {"FINISHED"}
    shown = {}
    for bits in (8, 12):
        small.icymoon.sensor.bits = bits
        assert bpy.ops.icymoon.expose() == {"FINISHED"}
        (folder,) = (tmp_path / "dataset" / "exposed").iterdir()
        shown[bits] = json.loads((folder / "images.json").read_text())["image_bits"]
        assert (Path(folder) / "left.png").is_file()
    assert shown == {8: 8, 12: 12}
    assert len(list((tmp_path / "dataset" / "pairs").iterdir())) == 1  # nothing was rendered for it


@pytest.fixture
def shown(small, monkeypatch, tmp_path):
    """A rendered pair whose left camera image is shown as in a window; what the panel says of it is a function."""
    monkeypatch.setattr(live_preview, "has_window", lambda: True)
    small.icymoon.live = False
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    assert bpy.ops.icymoon.render_pair() == {"FINISHED"}
    assert bpy.ops.icymoon.expose() == {"FINISHED"}
    (path,) = (tmp_path / "dataset" / "exposed").glob("*/left.png")
    image = bpy.data.images.load(str(path))
    monkeypatch.setattr(live_exposure, "list_shown_paths", lambda: [Path(bpy.path.abspath(image.filepath))])
    yield image
    session.reset()


def until_rested() -> int:
    """Call the timer's function as the event loop does, until it wants no more; how often it started a process."""
    started, before = 0, None
    end = time.monotonic() + 60
    while bpy.app.timers.is_registered(live_exposure.develop_waiting) and time.monotonic() < end:
        again = live_exposure.develop_waiting()
        started += session.developing is not None and session.developing is not before
        before = session.developing
        if again is None:
            bpy.app.timers.unregister(live_exposure.develop_waiting)
        time.sleep(0.02)
    assert session.developing is None
    return started


def brightness(image) -> float:
    return float(np.mean(image.pixels[:][::4]))


@pytest.mark.long
def test_the_shown_camera_image_follows_the_response_once_the_hand_rests(small, shown):
    before = brightness(shown)
    for target in (0.6, 0.4, 0.2, 0.1):  # one drag
        small.icymoon.sensor.auto_target = target
    assert until_rested() == 1
    assert brightness(shown) < 0.4 * before
    small.icymoon.rig.height_m = 3.0  # needs a render, not a development
    small.icymoon.quality.samples = 3
    assert not bpy.app.timers.is_registered(live_exposure.develop_waiting)
    small.icymoon.sensor.auto_target = 0.5
    live_exposure.develop_waiting()
    small.icymoon.sensor.auto_target = 0.8  # while that is developed
    assert until_rested() == 2
    assert brightness(shown) == pytest.approx(before, rel=0.01)
    assert live_exposure.list_lines() == []


@pytest.mark.long
def test_nothing_follows_where_it_is_switched_off_or_not_shown_and_failures_are_told(small, shown, monkeypatch):
    small.icymoon.follow = False
    small.icymoon.sensor.auto_target = 0.1
    assert not bpy.app.timers.is_registered(live_exposure.develop_waiting)
    small.icymoon.follow = True
    with monkeypatch.context() as patch:
        patch.setattr(live_exposure, "list_shown_paths", lambda: [Path("/elsewhere/left.png")])
        small.icymoon.sensor.auto_target = 0.2
        assert until_rested() == 0
    small.icymoon.rig.distortion_k1 = -10.0  # folds the image
    assert until_rested() == 1
    assert "Stereo Camera ▸ Distortion k1" in " ".join(live_exposure.list_lines())
    panel = next(p for p in CLASSES if getattr(p, "bl_idname", "") == "ICYMOON_PT_sensor")
    told = " ".join(shown["text"] for name, _, shown in drawn(panel) if name == "label")
    assert "Distortion k1" in told
    small.icymoon.rig.distortion_k1 = 0.0
    assert until_rested() == 1
    assert live_exposure.list_lines() == []


def following() -> jobs.Job:
    """The job that makes what is shown follow now."""
    return session.developing


def test_it_waits_for_a_running_job_and_is_stopped_by_another_file(small, shown, monkeypatch):
    monkeypatch.setattr(session, "job", object())
    small.icymoon.sensor.auto_target = 0.2
    assert live_exposure.develop_waiting() is not None
    assert session.developing is None
    monkeypatch.setattr(session, "job", None)
    assert live_exposure.develop_waiting() is not None
    process = following().process
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert session.developing is None
    assert process.returncode is not None
    assert not bpy.app.timers.is_registered(live_exposure.develop_waiting)
