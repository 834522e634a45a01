"""Which settings are hidden or grey, held against what they do."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from icymoon.physics.camera.blur import MOTION, find_blur
from icymoon.physics.camera.colour import compute_channel_rates
from icymoon.physics.camera.exposure_brackets import list_exposure_times
from icymoon.physics.camera.particle_hits import draw_hits
from icymoon.physics.camera.sensor import choose_exposure_s
from icymoon.physics.surfaces.hapke import bidirectional_reflectance, hapke_from_settings
from icymoon.physics.terrain.fine_detail import displace_by_relief
from icymoon.settings.description import defaults, merged
from icymoon.settings.table import TOPICS
from icymoon.settings.topics.declaration import LANDFORMS

#: Other values of the numbers of Hapke's law.
OTHERS = {
    "w": 0.5,
    "b": 0.2,
    "c": 0.6,
    "b_s0": 0.9,
    "h_s": 0.05,
    "b_c0": 0.7,
    "h_c": 0.03,
    "theta_bar_deg": 20.0,
    "filling_factor": 0.3,
    "h_function": "2002",
}


def root(**topics: dict) -> SimpleNamespace:
    """Stands in for ``Scene.icymoon``: the defaults with changes."""
    return SimpleNamespace(
        **{
            topic: SimpleNamespace(**values)
            for topic, values in ((topic, {**group, **topics.get(topic, {})}) for topic, group in defaults().items())
        }
    )


def relevant(topic: str, state: dict[str, dict] | None = None) -> set[str]:
    """The settings of a topic that are neither hidden nor grey."""
    of_scene = root(**(state or {}))
    return {
        setting.key
        for setting in TOPICS[topic].settings
        if TOPICS[topic].is_shown(setting.key, of_scene) and TOPICS[topic].has_effect(setting.key, of_scene)
    }


@pytest.mark.parametrize(
    "state",
    [{}, {"b": 0.0}, {"b_s0": 0.0}, {"b_c0": 0.0}, {"b_c0": 0.5, "h_c": 0.01}, {"b": 0.0, "b_s0": 0.0, "b_c0": 0.5}],
    ids=str,
)
@pytest.mark.parametrize("key", OTHERS)
def test_a_number_of_hapke_s_law_is_grey_where_another_changes_no_brightness(state, key):
    def brightness(**changes):
        law = hapke_from_settings(defaults().hapke | {"h_s": 0.01, "h_c": 0.01, **state, **changes})
        incidence, emission, azimuth = np.radians([[0.0, 20.0, 60.0], [1.0, 40.0, 50.0], [1.0, 30.0, 100.0]])
        return bidirectional_reflectance(incidence, emission, azimuth, law)

    acts = bool(np.any(brightness(**{key: OTHERS[key]}) != brightness()))
    assert TOPICS["hapke"].has_effect(key, root(hapke=state)) == acts


@pytest.mark.parametrize(
    "state", [{}, {"auto_exposure": False}, {"brackets": 3}, {"radiation_flux_cm2_s": 1e5}], ids=str
)
@pytest.mark.parametrize(
    ("key", "other"),
    [
        ("auto_percentile", 0.5),
        ("auto_target", 0.3),
        ("exposure_s", 0.7),
        ("bracket_stops", 5.0),
        ("radiation_depth_um", 99.0),
        ("radiation_e_per_um", 9.0),
    ],
)
def test_a_setting_of_exposure_or_radiation_is_hidden_or_grey_where_it_changes_no_exposure(state, key, other):
    def exposures(**changes):
        response = defaults().sensor | state | changes
        times = list_exposure_times(choose_exposure_s(np.linspace(0.0, 1.0, 99), 1e4, response), response)
        return [*times, draw_hits(response, (30, 40), 1e-5, 10.0, np.random.default_rng(0)).sum()]

    assert (key in relevant("sensor", {"sensor": state})) == (exposures(**{key: other}) != exposures())


@pytest.mark.parametrize("flux", [0.5, 1e5])
def test_radiation_and_what_depends_on_nothing_is_never_grey(flux):
    state = {"sensor": {"auto_exposure": False, "brackets": 3, "radiation_flux_cm2_s": flux}}
    sensor = TOPICS["sensor"]
    shown = {setting.key for setting in sensor.settings if sensor.is_shown(setting.key, root(**state))}
    assert relevant("sensor", state) == shown


@pytest.mark.parametrize("automatic", [True, False])
def test_only_the_exposure_that_is_used_is_shown(automatic):
    of_scene = root(sensor={"auto_exposure": automatic})
    for key in ("auto_percentile", "auto_target", "exposure_s"):
        assert TOPICS["sensor"].is_shown(key, of_scene) == (automatic == (key != "exposure_s"))


@pytest.mark.parametrize("colour", ["MONO", "BAYER"])
@pytest.mark.parametrize(
    ("key", "other"),
    [
        ("band_centre_nm", 650.0),
        ("band_width_nm", 90.0),
        ("quantum_efficiency", 0.1),
        ("red_centre_nm", 590.0),
        ("green_half_width_nm", 20.0),
        ("blue_efficiency", 0.2),
        ("filter_leak", 0.2),
        ("cut_on_nm", 420.0),
        ("cut_off_nm", 650.0),
    ],
)
def test_a_setting_of_glass_or_filters_is_hidden_where_it_changes_no_light(colour, key, other):
    def rates(**changes):
        return compute_channel_rates(defaults().light, defaults().sensor | {"colour": colour} | changes, 1e-5).tolist()

    assert TOPICS["sensor"].is_shown(key, root(sensor={"colour": colour})) == (rates(**{key: other}) != rates())


def test_sizes_of_clods_are_grey_without_clods():
    assert "clod_sizes" not in relevant("excavation", {"excavation": {"path": "LINE"}})
    assert "clod_sizes" in relevant("excavation", {"excavation": {"path": "LINE", "clods_m": 0.02}})
    assert "sorting" not in relevant("excavation", {"excavation": {"path": "LINE", "clods_m": 0.02}})
    many = {"path": "LINE", "clods_m": 0.02, "clod_sizes": "MANY"}
    assert "sorting" in relevant("excavation", {"excavation": many})


def test_exposure_and_readout_of_a_motion_are_grey_unless_something_moves():
    for time in ("motion_exposure_s", "readout_s"):
        assert not TOPICS["rig"].has_effect(time, root())
    for moving in MOTION:
        for speed in (-0.5, 0.5):
            for time in ("motion_exposure_s", "readout_s"):
                assert TOPICS["rig"].has_effect(time, root(rig={moving: speed}))
            assert find_blur(merged(defaults(), {"rig": {moving: speed, "motion_exposure_s": 0.1}})) is not None


@pytest.mark.parametrize(
    ("source", "shown"),
    [
        ({}, True),
        ({"kind": "MESH", "detail": True}, False),
        ({"kind": "STAND_IN"}, False),
        ({"kind": "HEIGHT_MAP"}, False),
        ({"kind": "HEIGHT_MAP", "detail": True}, True),
    ],
    ids=str,
)
def test_landforms_are_hidden_for_ground_that_has_none(source, shown):
    assert TOPICS["ridges"].is_shown("height_m", root(source=source)) == shown
    assert TOPICS["terrain"].is_shown("layers", root(source=source)) == shown


def test_roughness_on_a_mesh_has_no_landforms():
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3))
    plain, ridged = (merged(defaults(), {"ridges": {"height_m": height_m}}) for height_m in (0.0, 1.0))
    up = np.tile([0.0, 0.0, 1.0], (20, 1))
    assert np.array_equal(displace_by_relief(points, up, plain, 1), displace_by_relief(points, up, ridged, 1))


@pytest.mark.parametrize("topic", [name for name, topic in TOPICS.items() if topic.parent == LANDFORMS])
def test_a_landform_that_there_is_none_of_has_but_the_setting_that_makes_some(topic):
    keys = [setting.key for setting in TOPICS[topic].settings]
    assert relevant(topic) == set(keys[:1])
    assert relevant(topic, {topic: {keys[0]: 0.001}}) == set(keys)


PRINCIPLED = {
    "subsurface_weight",
    "transmission",
    "roughness",
    "specular",
    "refractive_index",
    "glint_share",
    "bubble_share",
    "fracture_share",
    "frost_share",
    "crust_share",
}
#: Shown with Lambert's law too.
GLOWING = "emitted_w_m2_sr"
IDLE = {
    "transmitted",
    "bubble_radius_m",
    "bubble_band_m",
    "fracture_spacing_m",
    "trough_width_m",
    "frost_from",
    "frost_tilt_deg",
    "frost_azimuth_deg",
    "frost_hold_deg",
    "frost_spread_deg",
    "frost_mask_file",
    "frost_patch_m",
    "patch_raggedness",
    "frost_albedo",
    "crust_patch_m",
    "crust_height_m",
    "crust_roughness",
    "albedo_patch_m",
    "subsurface_radius_m",
    "subsurface_method",
    "salt_patch_m",
    "salt_red",
    "salt_green",
    "salt_blue",
    "glint_size_m",
    "grain_patch_limit",
    "snow_grain_m",
    "dirt",
    "dirt_mask_file",
    "dirt_patch_m",
    "salt",
    "emitted_from",
    "emitted_below",
}
#: Settings of skirts that have an effect only with skirts.
_SKIRTS = {"skirt_repose_deg", "skirt_drift", "skirt_azimuth_deg"}
#: What only rocks with debris use.
_DEBRIS = {"debris_smallest_m", "debris_index", "debris_reach", "debris_most"}
#: What only rocks beyond the patch use.
_BEYOND = {"beyond_largest"}
#: What only rocks at rest use.
_REST = {"rolling_deg"}
#: What only baked light uses.
_BAKING = {"direct_samples", "bake_area", "bake_samples", "bake_noise"}
#: What a state of the settings leaves of a topic: all keys but those named, or those named alone.
CASES = [
    ("terrain", {}, "but", {"resolution"}),
    ("terrain", {"mesh": {"kind": "GRID"}}, "but", {"body_radius_m"}),
    ("terrain", {"source": {"kind": "MESH"}}, "only", set()),
    ("terrain", {"source": {"kind": "HEIGHT_MAP"}}, "only", {"size_m", "resolution"}),
    ("terrain", {"source": {"kind": "MESH", "detail": True}}, "but", {"body_radius_m", "layers"}),
    ("terrain", {"source": {"kind": "HEIGHT_MAP", "detail": True}}, "but", {"body_radius_m"}),
    ("mesh", {}, "but", set()),
    ("mesh", {"mesh": {"kind": "GRID"}}, "only", {"kind"}),
    ("talus", {}, "only", {"share"}),
    ("talus", {"talus": {"share": 1.0}}, "but", set()),
    ("talus", {"talus": {"share": 1.0, "cohesion_pa": 0.0}}, "but", {"weakness"}),
    ("talus", {"talus": {"share": 1.0}, "source": {"kind": "HEIGHT_MAP", "detail": True}}, "only", set()),
    ("hills", {}, "only", {"rms_slope_deg"}),
    ("hills", {"hills": {"rms_slope_deg": 1.0}}, "but", {"outcrop_m"}),
    ("hills", {"hills": {"rms_slope_deg": 1.0, "outcrops": 0.1}}, "but", set()),
    ("hills", {"hills": {"rms_slope_deg": 1.0}, "mesh": {"kind": "GRID"}}, "only", set()),
    ("source", {}, "only", {"kind"}),
    (
        "source",
        {"source": {"kind": "STAND_IN"}},
        "but",
        {
            "metres_per_pixel",
            "height_scale_m",
            "missing",
            "file",
            "site",
            "surroundings_m",
            "surroundings_file",
            "site_longitude_deg",
            "site_latitude_deg",
            "site_easting",
            "site_northing",
        },
    ),
    (
        "textures",
        {"textures": {"set": "STAND_IN"}},
        "but",
        {"albedo_file", "roughness_file", "normal_file", "transmission_file", "height_file"},
    ),
    (
        "source",
        {"source": {"kind": "MESH"}},
        "but",
        {
            "metres_per_pixel",
            "height_scale_m",
            "missing",
            "stand_in",
            "site",
            "surroundings_m",
            "surroundings_file",
            "site_longitude_deg",
            "site_latitude_deg",
            "site_easting",
            "site_northing",
        },
    ),
    (
        "source",
        {"source": {"kind": "HEIGHT_MAP"}},
        "but",
        {
            "scale",
            "up_axis",
            "flat_faces",
            "repair",
            "stand_in",
            "surroundings_file",
            "site_longitude_deg",
            "site_latitude_deg",
            "site_easting",
            "site_northing",
        },
    ),
    (
        "source",
        {"source": {"kind": "HEIGHT_MAP", "surroundings_m": 500.0, "site": "DEGREES"}},
        "but",
        {"scale", "up_axis", "flat_faces", "repair", "stand_in", "site_easting", "site_northing"},
    ),
    (
        "terrain",
        {"source": {"kind": "HEIGHT_MAP", "surroundings_m": 500.0}},
        "only",
        {"size_m", "resolution", "body_radius_m"},
    ),
    ("surface", {}, "but", {"lommel_seeliger_share", *IDLE}),
    (
        "surface",
        {
            "surface": {
                "subsurface_weight": 0.1,
                "salt_share": 0.1,
                "albedo_variation": 0.1,
                "glint_share": 0.01,
                "grain_patchiness": 0.1,
                "transmission": 0.1,
                "frost_share": 0.1,
                "crust_share": 0.1,
                "emitted_w_m2_sr": 0.1,
                "emitted_from": "HOLLOWS",
            }
        },
        "but",
        {
            "frost_tilt_deg",
            "frost_azimuth_deg",
            "frost_hold_deg",
            "frost_spread_deg",
            "lommel_seeliger_share",
            "snow_grain_m",
            "dirt",
            "dirt_mask_file",
            "dirt_patch_m",
            "bubble_radius_m",
            "bubble_band_m",
            "fracture_spacing_m",
        },
    ),
    (
        "surface",
        {"surface": {"frost_share": 0.1, "frost_from": "FALL"}},
        "but",
        {"lommel_seeliger_share", "frost_azimuth_deg", *IDLE}
        - {
            "frost_from",
            "frost_tilt_deg",
            "frost_hold_deg",
            "frost_spread_deg",
            "frost_mask_file",
            "frost_patch_m",
            "frost_albedo",
        }
        - {"patch_raggedness"},
    ),
    ("surface", {"surface": {"fracture_share": 0.1}}, "but", {"lommel_seeliger_share", *IDLE} - {"fracture_spacing_m"}),
    (
        "surface",
        {"surface": {"bubble_share": 0.01, "ice_colour": "SNOW"}},
        "but",
        {"lommel_seeliger_share", "albedo", "ice_colour"} | IDLE - {"bubble_radius_m", "bubble_band_m"},
    ),
    (
        "surface",
        {"surface": {"slope_dirt": 0.1, "dirt": "THOLIN", "ice_colour": "SNOW", "salt": "SULPHUR", "salt_share": 0.1}},
        "but",
        {"lommel_seeliger_share", "salt_red", "salt_green", "salt_blue"}
        | IDLE - {"snow_grain_m", "dirt", "dirt_mask_file", "dirt_patch_m", "salt", "salt_patch_m"},
    ),
    (
        "surface",
        {"surface": {"slope_dirt": 0.1, "dirt": "THOLIN", "dirt_patch_m": 0.1}},
        "but",
        {"lommel_seeliger_share"} | IDLE - {"dirt", "dirt_mask_file", "dirt_patch_m", "patch_raggedness"},
    ),
    (
        "surface",
        {"surface": {"grain_amplitude_m": 0.0}},
        "but",
        {"lommel_seeliger_share", "grain_size_m", "grain_patchiness", "relief", *IDLE},
    ),
    ("surface", {"surface": {"model": "LAMBERT"}}, "but", {"lommel_seeliger_share", *PRINCIPLED, *IDLE}),
    ("surface", {"surface": {"model": "LUNAR_LAMBERT"}}, "but", {GLOWING, *PRINCIPLED, *IDLE}),
    (
        "rock_surface",
        {"rocks": {"own_surface": True}, "rock_surface": {"model": "HAPKE"}},
        "but",
        {"albedo", "lommel_seeliger_share", GLOWING, *PRINCIPLED, *IDLE},
    ),
    ("hapke", {"hapke": {"backend": "NODES"}, "surface": {"model": "HAPKE"}}, "but", {"accuracy", "h_c"}),
    ("rocks", {}, "only", {"coverage"}),
    (
        "rocks",
        {"rocks": {"coverage": 0.01, "beyond_px": 3.0}},
        "but",
        {"shape_file", "cluster_blocks", "cluster_radius_m", "file", *_DEBRIS, *_REST, *_SKIRTS},
    ),
    (
        "rocks",
        {"rocks": {"coverage": 0.01}},
        "but",
        {"shape_file", "cluster_blocks", "cluster_radius_m", "file", *_BEYOND, *_DEBRIS, *_REST, *_SKIRTS},
    ),
    (
        "rocks",
        {"rocks": {"coverage": 0.01, "clustering": 0.1}},
        "but",
        {"shape_file", "file", *_BEYOND, *_DEBRIS, *_REST, *_SKIRTS},
    ),
    (
        "rocks",
        {"rocks": {"coverage": 0.01, "clustering": 0.1, "at_rest": True}},
        "but",
        {"shape_file", "file", *_BEYOND, *_DEBRIS, *_SKIRTS},
    ),
    (
        "rocks",
        {"rocks": {"coverage": 0.01, "clustering": 0.1, "skirt": 0.2}},
        "but",
        {"shape_file", "file", *_BEYOND, *_DEBRIS, *_REST},
    ),
    (
        "rocks",
        {"rocks": {"coverage": 0.01, "clustering": 0.1}, "source": {"kind": "MESH"}},
        "but",
        {"shape_file", "beyond_px", "file", "skirt", *_BEYOND, *_DEBRIS, *_REST, *_SKIRTS},
    ),
    (
        "rocks",
        {"rocks": {"coverage": 0.01, "clustering": 0.1}, "mesh": {"kind": "GRID"}},
        "but",
        {"shape_file", "beyond_px", "file", *_BEYOND, *_DEBRIS, *_REST, *_SKIRTS},
    ),
    (
        "rocks",
        {"rocks": {"coverage": 0.01, "clustering": 0.1, "law": "GOLOMBEK"}},
        "but",
        {"shape_file", "power_index", "file", *_BEYOND, *_DEBRIS, *_REST, *_SKIRTS},
    ),
    (
        "rocks",
        {"rocks": {"coverage": 0.01, "law": "TABLE"}},
        "but",
        {
            "shape_file",
            "mask_file",
            "power_index",
            "smallest_m",
            "largest_m",
            "clustering",
            "cluster_blocks",
            "cluster_radius_m",
            "beyond_px",
            *_BEYOND,
            *_DEBRIS,
            *_REST,
            *_SKIRTS,
        },
    ),
    (
        "rocks",
        {"rocks": {"coverage": 0.01, "clustering": 0.1, "family": "OWN"}},
        "but",
        {"file", "angularity", *_BEYOND, *_DEBRIS, *_REST, *_SKIRTS},
    ),
    ("rig", {}, "but", {"motion_exposure_s", "readout_s", "z_m"}),
    ("rig", {"rig": {"height_from": "ZERO"}}, "but", {"motion_exposure_s", "readout_s"}),
    ("rock_surface", {}, "only", set()),
    ("workspace", {}, "only", {"cell_m"}),
    ("workspace", {"workspace": {"cell_m": 0.02}}, "but", set()),
    ("dataset", {}, "but", {"plan", "maps", "map_cell_m"}),
    ("dataset", {"dataset": {"plan": "mine.toml"}}, "but", {"maps", "map_cell_m"}),
    ("dataset", {"source": {"kind": "HEIGHT_MAP"}}, "but", {"plan", "map_cell_m"}),
    ("dataset", {"source": {"kind": "HEIGHT_MAP"}, "dataset": {"maps": True}}, "but", {"plan"}),
    ("quality", {}, "but", _BAKING),
    ("quality", {"surface": {"model": "HAPKE"}}, "but", {"fine_relief", *_BAKING}),
    ("quality", {"surface": {"model": "LAMBERT"}}, "but", _BAKING),
    ("quality", {"surface": {"model": "HAPKE"}, "rocks": {"own_surface": True}}, "but", _BAKING),
    (
        "quality",
        {"surface": {"model": "HAPKE"}, "rocks": {"own_surface": True}, "rock_surface": {"model": "HAPKE"}},
        "but",
        {"fine_relief", *_BAKING},
    ),
    ("quality", {"quality": {"indirect": "BAKED"}}, "but", set()),
    ("quality", {"quality": {"indirect": "AUTO"}}, "but", set()),
    ("textures", {}, "only", {"set"}),
    ("textures", {"textures": {"set": "FROST"}}, "only", {"set", "mapping", "width_m", "repeat", "height_m"}),
    ("textures", {"textures": {"set": "FROST", "mapping": "UV"}}, "only", {"set", "mapping", "height_m"}),
    ("textures", {"textures": {"set": "OWN"}}, "but", {"stand_in"}),
    ("textures", {"textures": {"set": "OWN", "mapping": "UV"}}, "but", {"width_m", "repeat", "stand_in"}),
    ("textures", {"textures": {"set": "OWN", "mapping": "PATCH"}}, "but", {"width_m", "repeat", "stand_in"}),
    ("textures", {"textures": {"set": "MESH"}}, "only", {"set"}),
]


@pytest.mark.parametrize(
    ("topic", "state", "how", "keys"),
    CASES,
    ids=lambda value: str(sorted(value) if isinstance(value, set) else value)[:70],
)
def test_what_choices_and_other_numbers_leave_of_a_topic(topic, state, how, keys):
    every = {setting.key for setting in TOPICS[topic].settings}
    assert keys <= every
    assert relevant(topic, state) == (keys if how == "only" else every - keys)


def of_light(**state) -> set[str]:
    return relevant("light", {"light": state})


def test_what_a_date_gives_is_not_asked_for_and_a_planet_or_stars_that_are_not_there_have_no_settings():
    of_others = {"place", "lamp_scales", "ies_file"}  # of a map, of lamps
    every = {setting.key for setting in TOPICS["light"].settings} - of_others
    dated = {"body", "date_utc", "longitude_deg", "moons"}
    given = {
        key
        for key in every
        if key.startswith(("sun_", "planet_"))
        and key.endswith(("elevation_deg", "azimuth_deg", "diameter_deg", "irradiance_wm2", "flattening"))
    }
    planet = {key for key in every if key.startswith("planet_")} | {"moons"}
    stars = {"stars_faintest_mag"}
    assert of_light() == every - dated - {"parent", "kernels", "latitude_deg"} - planet - stars
    assert of_light(planet=True) == every - dated - {"parent", "kernels"} - stars
    assert of_light(stars=True) == every - dated - {"parent", "kernels"} - planet
    assert of_light(directions_from="ELEMENTS") == every - given - {"parent", "kernels"} - planet - stars
    assert of_light(directions_from="KERNELS", planet=True, stars=True) == every - given
    assert of_light(lamps=[{}]) == of_light() | {"lamp_scales", "ies_file"}
