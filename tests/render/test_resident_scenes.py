"""Scenes rendered one after the other by one process: the worker that stays, and this process."""

from __future__ import annotations

import os
import signal
from typing import Any

import icymoon
import numpy as np
import pytest
from icymoon import IcyMoonError, Scene
from icymoon.support.arrays import Array

pytestmark = pytest.mark.heavy  # a Blender or two are started, or scenes built

TINY: Any = {
    "rig": {"width_px": 48, "height_px": 36},
    "terrain": {"resolution": 33},
    "mesh": {"kind": "GRID"},
    "quality": {"samples": 2, "threads": 1, "truth": "DEPTH"},
}


@pytest.mark.long
def test_the_worker_stays_and_its_pairs_are_those_of_a_fresh_one(tmp_path):
    scene = Scene(**TINY)
    with icymoon.Worker(threads=1) as worker:
        assert "not started" in repr(worker)
        first = scene.render(tmp_path / "a", renderer=worker)
        process = worker._process
        with pytest.raises(IcyMoonError, match="albedo"):  # and goes on after a scene that cannot be
            Scene(**TINY | {"surface": {"model": "HAPKE"}, "textures": {"set": "OWN", "albedo_file": "no.png"}}).render(
                tmp_path / "a", renderer=worker
            )
        second = scene.change(light={"sun_elevation_deg": 60.0}).render(tmp_path / "a", renderer=worker)
        assert worker._process is process
        # Built by what the scene before it was changed into; the same numbers as built from nothing.
        alone = icymoon.InProcess()
        other = scene.change(light={"sun_elevation_deg": 60.0}).render(tmp_path / "b", renderer=alone)
        alone.close()
        assert second.id == other.id != first.id
        for each in ("radiance", "depth_m"):
            assert np.array_equal(getattr(second.left, each), getattr(other.left, each), equal_nan=True)


@pytest.mark.long
def test_a_worker_that_dies_is_a_sentence_and_the_next_render_starts_another(tmp_path):
    with icymoon.Worker(threads=1) as worker:
        worker.render(Scene(**TINY).settings, tmp_path)
        os.kill(worker._process.pid, signal.SIGKILL)
        with pytest.raises(IcyMoonError, match="without a result"):
            Scene(**TINY).render(tmp_path, renderer=worker, again=True)
        assert worker._process is None
        assert Scene(**TINY).render(tmp_path, renderer=worker, again=True).folder.is_dir()


def test_a_complete_pair_starts_no_blender(tmp_path):
    with icymoon.InProcess() as here:
        pair = Scene(**TINY).render(tmp_path, renderer=here)
    with icymoon.Worker("no such blender") as worker:
        assert Scene(**TINY).render(tmp_path, renderer=worker).id == pair.id
        with pytest.raises(IcyMoonError, match="no such blender"):
            Scene(**TINY).render(tmp_path, renderer=worker, again=True)


def points_of(pair: icymoon.RenderedPair) -> Array:
    """World coordinates (H, W, 3) of what the left pixels see, in metres."""
    camera, depth = pair.camera, pair.depth_m
    v, u = np.mgrid[: camera.height_px, : camera.width_px] + 0.5
    eye = np.stack(
        [(u - camera.cx_px) / camera.focal_px * depth, (v - camera.cy_px) / camera.focal_px * depth, depth], axis=-1
    )
    pose = pair.left.pose_to_world
    return eye @ pose[:3, :3].T + pose[:3, 3]


def test_own_heights_and_albedo_are_where_they_were_put(tmp_path):
    """Seen from above: what the camera measures lies on the function, and light follows the albedo of its place."""

    def height(x: Array, y: Array) -> Array:
        return 0.05 * x - 0.02 * y

    def albedo(x: Array, y: Array) -> Array:
        return np.where(x + 0.5 * y > 1.0, 0.8, np.where(y > 3.0, 0.2, 0.4))

    scene = Scene(
        **TINY
        | {
            "rig": {"width_px": 96, "height_px": 72, "height_m": 12.0, "pitch_deg": 89.0},
            "surface": {"model": "LAMBERT", "grain_amplitude_m": 0.0},
            "light": {"planet": False, "sun_elevation_deg": 50.0},
            "quality": {"samples": 16, "threads": 1, "diffuse_bounces": 0, "truth": "DEPTH"},
        }
    )
    with icymoon.InProcess() as here:
        pair = scene.with_heights(height).with_albedo(albedo, resolution=256).render(tmp_path, renderer=here)
    x, y, z = np.moveaxis(points_of(pair), -1, 0)
    on = (np.abs(x) < 9.5) & (np.abs(y) < 9.5)
    assert on.mean() > 0.5
    # Cycles' depth has single precision, 1e-6 of 12 m, and the mesh's heights too.
    assert z[on] == pytest.approx(height(x, y)[on], abs=1e-4)
    # A plane under a far Sun: radiance is proportional to the albedo, but for pixels that edges run through.
    grey = pair.left.radiance.mean(axis=2)
    edge = np.minimum(np.abs(x + 0.5 * y - 1.0), np.abs(y - 3.0)) < 0.5
    for value in (0.2, 0.4):
        ratio = grey[on & ~edge & (albedo(x, y) == value)].mean() / grey[on & ~edge & (albedo(x, y) == 0.8)].mean()
        assert ratio == pytest.approx(value / 0.8, rel=2e-3)


def test_own_rocks_are_seen_where_they_were_put(tmp_path):
    scene = Scene(
        **TINY
        | {
            "rig": {"width_px": 96, "height_px": 72, "height_m": 12.0, "pitch_deg": 89.0},
            "quality": {"samples": 1, "threads": 1, "truth": "FULL"},
        }
    ).with_heights(lambda x, y: 0 * x)
    rocks = np.array([[2.0, 1.0, 1.5], [-3.0, 2.0, 2.0], [30.0, 0.0, 1.0]])
    with icymoon.InProcess() as here, pytest.warns(UserWarning, match="lacks 1 rock of"):
        pair = scene.with_rocks(rocks).render(tmp_path, renderer=here)
    x, y, _ = np.moveaxis(points_of(pair), -1, 0)
    rock = pair.left.semantic == 2
    for east, north, diameter in rocks[:2]:
        mine = rock & (np.hypot(x - east, y - north) < diameter)
        assert np.hypot(x[mine].mean() - east, y[mine].mean() - north) < 0.2 * diameter
        # As wide as stated, by the area of its outline: shapes have that of a circle of the diameter, from above.
        pixel_m2 = (12.0 / pair.camera.focal_px) ** 2
        assert mine.sum() * pixel_m2 == pytest.approx(np.pi / 4 * diameter**2, rel=0.5)
    assert rock.sum() == sum((rock & (np.hypot(x - e, y - n) < d)).sum() for e, n, d in rocks[:2])


def test_a_window_is_not_closed_by_a_render(monkeypatch):
    from icymoon.render import resident_scenes

    class App:
        background = False

    monkeypatch.setattr(resident_scenes.bpy, "app", App)
    with pytest.raises(IcyMoonError, match=r"icymoon\.Worker"):
        icymoon.InProcess()
