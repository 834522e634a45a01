"""Painted masks of dirt and frost: the surface follows the same values as the rocks, in the same places."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from icymoon.benchmarks.common.renders import open_empty_file
from icymoon.benchmarks.light import furnace
from icymoon.formats.png import encode_png
from icymoon.nodes.surface.ice_material import build_material
from icymoon.nodes.surface.images import load_mask_image
from icymoon.nodes.surface.textures import Painted
from icymoon.physics.rocks.painted_mask import PaintedMask, read_mask
from icymoon.settings.description import defaults, merged
from icymoon.support.labels import TERRAIN

PATCH_M, VIEW_M, PIXELS = 2.0, 3.0, 16
PLAIN: dict[str, Any] = {"grain_amplitude_m": 0.0, "specular": 0.0, "albedo": 0.8}


@pytest.mark.parametrize(
    ("kind", "changes", "covered", "error"),
    [
        ("dirt", {"model": "LAMBERT", "slope_dirt": -1.0}, 0.0, 1e-3),
        ("frost", {"frost_share": 1.0, "frost_albedo": 0.2}, 0.2, 0.02),  # noise: Cycles chooses a layer by chance
    ],
)
def test_cover_follows_the_mask(tmp_path, kind, changes, covered, error):
    (tmp_path / "mask.png").write_bytes(encode_png(np.random.default_rng(4).integers(0, 256, (3, 4), np.uint8)))
    surface = merged(defaults(), {"surface": {**PLAIN, **changes}}).surface
    scene = open_empty_file()
    painted = Painted({kind: load_mask_image(tmp_path / "mask.png")}, PATCH_M)
    furnace.plane(scene, "Ground", 0.0, 100.0, build_material("Test", surface, 1, TERRAIN, painted=painted))
    scene.render.engine, scene.cycles.samples, scene.world = "CYCLES", 16, furnace.shining()
    scene.cycles.filter_width = 0.01
    found = furnace.radiance(scene, 0.0, VIEW_M, PIXELS)[..., 1]
    at = ((np.arange(PIXELS) + 0.5) / PIXELS - 0.5) * VIEW_M
    north, east = np.meshgrid(-at, -at, indexing="ij")  # row 0 northernmost, column 0 easternmost
    share = PaintedMask(read_mask(tmp_path / "mask.png"), PATCH_M).shares(east, north)
    assert np.abs(found - 0.8 * (1 - share) - covered * share).mean() < error


@pytest.mark.parametrize("changes", [{"slope_dirt": 0.5}, {"frost_share": 0.5}])
def test_without_a_mask_of_it_a_cover_has_the_same_nodes(tmp_path, changes):
    (tmp_path / "mask.png").write_bytes(encode_png(np.zeros((2, 2), np.uint8)))
    other = "frost" if "slope_dirt" in changes else "dirt"
    surface = merged(defaults(), {"surface": changes}).surface
    painted = Painted({other: load_mask_image(tmp_path / "mask.png")}, PATCH_M)
    plain = {node.name for node in build_material("Test", surface, 1, TERRAIN).node_tree.nodes}
    masked = {node.name for node in build_material("Test", surface, 1, TERRAIN, painted=painted).node_tree.nodes}
    assert not {name for name in masked - plain if "Painted" in name}
