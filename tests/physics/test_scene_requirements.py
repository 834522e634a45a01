"""What a scene requires, by its settings alone, and that nothing else is loaded."""

from __future__ import annotations

import json
import math
import subprocess
import sys

import pytest
from icymoon.physics import scene_requirements
from icymoon.physics.light.sky import compute_sky, describe_sky
from icymoon.settings import description, rebuilt_parts
from icymoon.settings.topics.scene import Settings
from icymoon.support.version import ROOT


def described(*parts: dict) -> Settings:
    return description.merged(description.defaults(), *(description.check(part, "test") for part in parts))


SNOW = {"surface": {"subsurface_weight": 1.0, "subsurface_radius_m": 0.005}}


def test_the_nearest_ground_is_at_the_foot_of_the_image():
    rig = described(
        {
            "rig": {
                "height_m": 2.0,
                "pitch_deg": 30.0,
                "focal_length_mm": 30.0,
                "sensor_width_mm": 60.0,
                "width_px": 640,
                "height_px": 640,
            }
        }
    )["rig"]
    assert scene_requirements.nearest_ground_m(rig) == pytest.approx(2.0 / math.sin(math.radians(30.0 + 45.0)))
    assert scene_requirements.nearest_ground_m(rig | {"pitch_deg": 80.0}) == 2.0  # straight down is in the image
    assert scene_requirements.nearest_ground_m(rig | {"pitch_deg": -60.0}) == 2.0  # no level ground is: be careful
    assert scene_requirements.nearest_ground_m(rig | {"overscan": 1.0}) < scene_requirements.nearest_ground_m(rig)


def test_a_walk_is_worth_it_where_a_pixel_is_as_small():
    """5 mm at 1.6 m: 341 px of focal length make it 1.07 px, a tenth at ten times the height."""
    settings = described(SNOW)
    assert scene_requirements.random_walk_px(settings, "surface") == pytest.approx(0.005 * 341.33 / 1.6, rel=0.02)
    assert scene_requirements.traces_random_walk(settings, "surface")
    high = described(SNOW, {"rig": {"height_m": 20.0}})
    assert not scene_requirements.traces_random_walk(high, "surface")
    assert scene_requirements.simplify_surface(high, "surface") == high["surface"] | {"subsurface_weight": 0.0}
    exact = described(SNOW, {"rig": {"height_m": 20.0}, "quality": {"walk_px": 0.0}})
    assert scene_requirements.traces_random_walk(exact, "surface")
    assert not scene_requirements.traces_random_walk(described({"quality": {"walk_px": 0.0}}), "surface")
    assert not scene_requirements.traces_random_walk(described(SNOW, {"surface": {"model": "LAMBERT"}}), "surface")
    assert rebuilt_parts.select_appearance(high) != rebuilt_parts.select_appearance(settings)
    assert rebuilt_parts.select_appearance(
        described(SNOW, {"rig": {"pitch_deg": 50.0}})
    ) == rebuilt_parts.select_appearance(settings)


def test_what_is_left_out_is_told_with_its_reason():
    plain = described()
    assert scene_requirements.find_left_out(plain, describe_sky(compute_sky(plain["light"]))) == []
    own = described(
        {
            "rocks": {"own_surface": True, "coverage": 0.1},
            "rock_surface": SNOW["surface"],
            "rig": {"height_m": 50.0},
            "light": {"planet": True, "planet_elevation_deg": -50.0},
            "quality": {"truth": "DEPTH"},
        }
    )
    said = scene_requirements.find_left_out(own, describe_sky(compute_sky(own["light"])))
    assert [line.split(":")[0] for line in said] == ["rock_surface", "light", "truth"]
    assert "5 mm is 0.03" in said[0]


def test_the_planet_counts_against_the_sun_of_the_ground_that_it_lights():
    def share(**light):
        return compute_sky(described({"light": {"planet": True, **light}})["light"]).planet_over_sun

    assert 1e-3 < share() < 1.0
    assert share(sun_elevation_deg=1.0) > share()  # level ground gets little of a low Sun
    assert share(sun_elevation_deg=-5.0, sun_azimuth_deg=180.0) == math.inf
    assert share(planet_elevation_deg=-50.0) == 0.0
    assert compute_sky(described()["light"]).planet_over_sun == 0.0


def test_torch_is_loaded_for_networks_only():
    program = (
        "import sys\nimport numpy as np\nimport icymoon.stereo.cli\nimport icymoon.stereo.evaluate\n"
        "from icymoon.stereo.matchers.methods import parse_methods\nprint(parse_methods('bm,sgbm'))\n"
        "assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=240, stdout=subprocess.DEVNULL)


def test_the_table_is_of_what_the_benchmark_measures():
    pytest.importorskip("bpy")
    from icymoon.benchmarks.cost import requires as benchmark

    stored = json.loads((ROOT / "docs" / "make" / "requires.json").read_text(encoding="utf-8"))
    for name, feature in benchmark.FEATURES.items():
        row = stored["rows"][name]
        assert (row["title"], row["needed"], row["changes"]) == (feature.title, feature.needed, feature.changes)
        assert row["ratio"] == pytest.approx(row["on_s"] / row["off_s"], rel=0.02)
        for side in (feature.on, feature.off):
            if isinstance(side, dict):
                description.check(side, name)
    assert set(stored["rows"]) == set(benchmark.FEATURES)
