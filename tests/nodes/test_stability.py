"""One description and seed give the same ground, truth and light in every Blender, or the manual says otherwise."""

from __future__ import annotations

import json

import numpy as np
import pytest
import stability
from icymoon.render.pairs.pair_folder import EYES
from icymoon.support.blender import compat

TABLE = json.loads(stability.TABLE.read_text(encoding="utf-8"))
#: By Blender and scene: how far the mean radiance is off the table's, relative, and the regions' beside the noise.
#: 4.2 follows no walk under snow that is shorter than a pixel and loses less light on bumps: docs/theory/limits.md.
MOVED = {"4.2": {"snow": (-0.007, 0.04), "planetshine": (0.009, 0.015)}}
#: Standard deviations of the light paths' noise that one render may be off: the table knows them from 8 renders.
_SIGMAS = 6.0


@pytest.fixture(scope="module", params=stability.SCENES)
def scene(request):
    return request.param, stability.built(request.param)


@pytest.mark.ci_takes(2)
def test_vertices_are_the_same(scene):
    """They are made by numpy in double precision and rounded to six or seven digits in places, so that the last bit of
    a sine, which differs between machines, does not show: what is left is that of a single-precision coordinate."""
    name, built = scene
    found, wanted = stability.of_ground(built), TABLE[name]["ground"]
    assert (found["vertices"], found["faces"]) == (wanted["vertices"], wanted["faces"])
    np.testing.assert_allclose(found["some"], wanted["some"], rtol=2e-7, atol=1e-6)
    np.testing.assert_allclose(found["magnitude"], wanted["magnitude"], rtol=1e-6)


@pytest.mark.long
def test_truth_is_the_same_and_the_light_as_stated(scene, tmp_path):
    name, built = scene
    found, wanted = stability.of_pair(built, tmp_path), TABLE[name]
    moved, regions_moved = MOVED.get(compat.choose_principled_table(), {}).get(name, (0.0, 0.0))
    for eye in EYES:
        depth, true = (np.array(each[eye]["depth"]) for each in (found, wanted))
        # Ten roundings to 24 bits; a ray through an edge may fall on either side.
        assert np.count_nonzero(np.abs(depth - true) > 1e-6 * true) <= 1
        assert found[eye]["blocks"] == pytest.approx(wanted[eye]["blocks"], abs=2 / 64 / 48)
        radiance, mean = np.array(found[eye]["radiance"]), np.array(wanted[eye]["radiance"])
        # The table's mean of 8 has a noise too.
        noise = _SIGMAS * np.sqrt(1 + 1 / stability.REPEATS)
        # A region's noise, known from 8 renders, may be underrated by half: the regions lend each other theirs.
        of_region = np.maximum(wanted[eye]["noise"], np.median(np.array(wanted[eye]["noise"]) / mean) * mean)
        # The noise of the image's mean may be underrated threefold: that of the regions says what it is at least.
        of_mean = max(wanted[eye]["mean_noise"], np.linalg.norm(wanted[eye]["noise"]) / mean.size)
        assert abs(radiance.mean() / mean.mean() - 1 - moved) < noise * of_mean / mean.mean() + 1e-4
        assert (np.abs(radiance / mean - 1) < noise * of_region / mean + regions_moved + 1e-4).all()
