"""Pictures of the first and the last pair of Vary This Scene, before it is rendered."""

from __future__ import annotations

import tempfile

import bpy
import numpy as np
import pytest
from icymoon.operators import jobs, variation_pictures
from icymoon.panels import vary
from icymoon.settings import description, preset_files
from icymoon.settings.blender import scene_properties
from icymoon.support.blender import compat
from panel_drawing import drawn, texts
from plans import TINY

ELEVATION = "light.sun_elevation_deg"


def mean_brightness() -> list[float]:
    """The mean of each kept picture, of those that are shown now."""
    scene = bpy.context.scene
    key = variation_pictures._make_picture_key(scene, scene_properties.read_settings(scene.icymoon))
    names = variation_pictures._made[key]
    return [float(np.mean(variation_pictures._pictures.collection[name].image_pixels_float[:])) for name in names]


def buttons() -> set[str]:
    return {entry[1] for entry in drawn(vary.ICYMOON_PT_vary) if entry[0] == "operator"}


@pytest.fixture
def varied(scene, tmp_path, monkeypatch):
    """A tiny scene over which the Sun sets, and temporary folders of the test's own."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    scene_properties.write_settings(scene.icymoon, {**TINY, "sensor": {"auto_exposure": False, "exposure_s": 1e-4}})
    bpy.ops.icymoon.vary(setting=ELEVATION, first=60, last=0.5, count=3)
    yield scene
    variation_pictures.unregister()


@pytest.mark.heavy
def test_the_ends_are_shown_until_what_they_show_changes(varied, tmp_path):
    assert "icymoon.show_ends" in buttons()
    assert variation_pictures.find_icons(varied) == ()
    assert bpy.ops.icymoon.show_ends() == {"FINISHED"}
    assert len(variation_pictures.find_icons(varied)) == 2  # both 0 without a window
    first, last = mean_brightness()
    assert first > 1.2 * last  # the Sun is high in the first, and low in the last
    assert list(tmp_path.iterdir()) == []
    record = drawn(vary.ICYMOON_PT_vary)
    assert sum(entry[0] == "template_icon" for entry in record) == 2
    assert "First" in texts(record)
    assert "icymoon.show_ends" not in buttons()
    for topic, key, value, same in (
        ("quality", "samples", 99, True),
        ("dataset", "workers", 2, True),
        ("surface", "albedo", 0.11, False),
        ("sensor", "gain", 2.5, False),
    ):
        group = getattr(varied.icymoon, topic)
        was = getattr(group, key)
        setattr(group, key, value)
        assert bool(variation_pictures.find_icons(varied)) == same, key
        setattr(group, key, was)
        assert len(variation_pictures.find_icons(varied)) == 2
    varied.icymoon.variations.varied[0].last = 0.75
    assert variation_pictures.find_icons(varied) == ()


@pytest.mark.parametrize("denoises", [True, False])
def test_pictures_are_small_and_rough_for_every_scene(monkeypatch, denoises):
    monkeypatch.setattr(compat, "has_oidn", lambda: denoises)
    for name in preset_files.preset_names("scenes")[::7]:
        settings = description.merged(description.defaults(), preset_files.load_preset(name))
        found = variation_pictures.make_rough_settings(settings)
        description.check(found, name)
        assert max(found.rig.width_px, found.rig.height_px) <= (128 if denoises else 96)
        assert found.quality.denoiser == ("OIDN" if denoises else "NONE")
        assert found.rig.width_px / found.rig.height_px == pytest.approx(
            settings.rig.width_px / settings.rig.height_px, rel=0.02
        )
        assert found.mesh.most <= 20_000
        for topic in ("light", "surface", "sensor", "terrain", "source"):
            changed = {key for key in found[topic] if found[topic][key] != settings[topic][key]}
            assert changed <= {"resolution"}


def test_nothing_that_varies_has_no_ends(scene):
    assert not bpy.ops.icymoon.show_ends.poll()
    scene.icymoon.variations.seeds = 2
    assert bpy.ops.icymoon.show_ends.poll()


def test_a_stopped_job_leaves_nothing_and_shows_nothing(varied, tmp_path, monkeypatch):
    started = []

    def stop(job: jobs.Job) -> bool:
        started.append(job)
        job.process.stop()
        return False

    monkeypatch.setattr(jobs.Job, "poll", stop)
    with pytest.raises(RuntimeError, match="was stopped; there are no new pictures"):
        bpy.ops.icymoon.show_ends()
    assert len(started) == 1
    assert variation_pictures.find_icons(varied) == ()
    assert list(tmp_path.iterdir()) == []


def test_the_pictures_of_many_ends_are_not_all_kept(varied):
    picture = np.zeros((3, 4, 3), np.uint8)
    for k in range(variation_pictures._MAX_SCENES + 1):
        variation_pictures._keep_pictures(str(k), [picture, picture])
    assert 1 <= len(variation_pictures._made) <= variation_pictures._MAX_SCENES
    assert len(variation_pictures._pictures.collection) == 2 * len(variation_pictures._made)
