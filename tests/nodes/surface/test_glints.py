"""Glints: off they cost nothing; on, facets shine toward the Sun, stay in place, and most shine to one eye only."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.benchmarks.light.furnace import albedo as furnace
from icymoon.nodes.surface.ice_material import build_material
from icymoon.physics.rig.focal_length import focal_px
from icymoon.stereo.images.exr import read_truth, read_view
from icymoon.support.labels import TERRAIN
from rendering import complete, empty_scene, render

#: Level, even snow, seen toward the Sun.
SNOW = {
    "terrain": {"rms_slope_deg": 0.0},
    "light": {"sun_elevation_deg": 30.0, "sun_azimuth_deg": 0.0},
    "surface": {"albedo": 0.9, "specular": 0.0, "grain_amplitude_m": 0.0},
    "quality": {"samples": 64, "denoiser": "NONE"},
    "rig": {"width_px": 160, "height_px": 120, "pitch_deg": 40.0, "baseline_m": 0.25},
}
GLINTS = {"surface": {"glint_share": 0.1}}
#: A glint is this many times as bright as the ground around.
BRIGHT = 1.5


def _material(*changes):
    empty_scene()
    settings = complete(*changes)
    return build_material("Test", settings.surface, 1, TERRAIN, None, settings)


def _radiance(folder, *changes, eye="left"):
    return read_view(render(folder, SNOW, *changes)[0].image(eye)).radiance[..., 0].astype(np.float64)


def _are_glints(radiance):
    """Where pixels below the horizon are bright among their row."""
    rows = np.median(radiance, axis=1, keepdims=True)
    ground = (radiance > 0.0).all(axis=1, keepdims=True)
    return ground & (radiance > BRIGHT * rows)


def test_off_they_add_no_node_and_on_their_inputs_are_the_settings():
    assert "Facets" not in _material().node_tree.nodes
    nodes = _material({"surface": {"glint_share": 0.03, "glint_size_m": 0.002}}).node_tree.nodes
    assert nodes["Facets"].distribution == "MULTI_GGX"
    for model in ("LAMBERT", "HAPKE"):  # they belong to the snow
        assert "Facets" not in _material({"surface": {"glint_share": 0.03, "model": model}}).node_tree.nodes


@pytest.mark.parametrize("share", [0.03, 0.5])
def test_facets_reflect_nearly_all_light_that_snow_does(share):
    """A facet that slopes sends some light into the ground: of all that facets reflect less than a fifth."""
    settings = complete({"surface": {"glint_share": share, "grain_amplitude_m": 0.0, "albedo": 0.9, "specular": 0.0}})
    made = furnace(lambda: build_material("Test", settings.surface, 1, TERRAIN, None, settings)).mean()
    assert 0.9 * (1 - 0.2 * share) < made < 0.9 * 1.005


@pytest.mark.long
def test_they_shine_toward_the_sun_and_leave_the_mean(tmp_path):
    none, toward, away = (
        _radiance(tmp_path / str(k), *changes)
        for k, changes in enumerate(((), (GLINTS,), (GLINTS, {"light": {"sun_azimuth_deg": 180.0}})))
    )
    assert not _are_glints(none).any()
    assert 0.002 < _are_glints(toward).mean() < 0.1
    assert _are_glints(away).mean() < 0.05 * _are_glints(toward).mean()
    # A tenth of the light leaves by a broad lobe instead of evenly. The lobe is about twice as bright as snow here.
    assert none.mean() < toward.mean() < 1.12 * none.mean()


@pytest.mark.long
def test_they_stay_where_they_are_and_move_with_the_seed(tmp_path):
    first, again, other = (
        _are_glints(_radiance(tmp_path / str(k), GLINTS, changes))
        for k, changes in enumerate(({}, {"light": {"sun_irradiance_wm2": 20.0}}, {"dataset": {"seed": 9}}))
    )

    def overlap(a, b):
        return (a & b).sum() / min(a.sum(), b.sum())

    # The light paths of the second differ; a tenth of the glints are near the limit.
    assert overlap(first, again) > 0.6
    # Toward the Sun a quarter of the pixels are glints, so many are in both by chance.
    assert overlap(first, other) < 0.6 * overlap(first, again)


def _share_in_both_eyes(folder, baseline_m):
    pair, _ = render(folder, SNOW, GLINTS, {"rig": {"baseline_m": baseline_m}})
    left, right = (
        _are_glints(read_view(pair.image(eye)).radiance[..., 0].astype(np.float64)) for eye in ("left", "right")
    )
    depth = read_truth(pair.image("left")).depth
    rows, columns = np.nonzero(left & (depth > 0.0))
    match = np.round(columns - focal_px(pair.settings.rig) * baseline_m / depth[rows, columns]).astype(int)
    rows, match = rows[match > 0], match[match > 0]
    assert len(rows) > 50
    # The other eye's pixel, or one beside it: places fall between pixels.
    return np.any([right[rows, np.minimum(match + k, right.shape[1] - 1)] for k in (-1, 0, 1)], axis=0).mean()


@pytest.mark.long
def test_the_further_apart_the_eyes_are_the_fewer_glints_they_share(tmp_path):
    """Of eyes 1 cm apart both see a facet; of eyes 1 m apart, which see it 20 degrees apart, mostly one does."""
    near, far = (_share_in_both_eyes(tmp_path / str(apart), apart) for apart in (0.01, 1.0))
    assert near > 0.7
    assert far < 0.4
