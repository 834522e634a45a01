"""Which settings of a long topic are in a sub-panel, which is closed at first."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from ..settings.table import TOPICS


@dataclass(frozen=True)
class Section:
    """A sub-panel of a topic's panel. ``switch`` is the setting whose tick is in its header, if it has one.

    The section ADVANCED holds what few scenes change, and comes last.
    """

    topic: str
    key: str
    label: str
    description: str
    settings: tuple[str, ...]
    switch: str = ""


ADVANCED = "advanced"
#: What a narrow sidebar has room for after Advanced, of topics with a longer label.
_BRIEF = {"rig": "Camera", "sensor": "Exposure", "quality": "Quality"}
#: Topics whose panel is inside the panel of another topic.
INSIDE = {"source": "terrain", "excavation": "terrain", "hills": "terrain", "mesh": "terrain", "hapke": "surface",
          "textures": "surface", "rock_surface": "rocks", "arm": "lander", "workspace": "lander"}


def _advanced(topic: str, *settings: str) -> Section:
    # Blender indents what is inside a sub-panel no further, so the label tells what it belongs to.
    return Section(topic, ADVANCED, f"Advanced {_BRIEF.get(topic, TOPICS[topic].label)}",
                   "Settings that few scenes change", settings)


def _of_surface(topic: str) -> tuple[Section, ...]:
    return (Section(topic, "dirt", "Colour, Dirt and Salts", "Colour of the ice, and darker or redder ground on it", (
                "ice_colour", "snow_grain_m", "albedo_variation", "albedo_patch_m", "face_variation", "trough_dirt",
                "slope_dirt", "dirt", "dirt_patch_m", "salt_share", "salt_patch_m", "salt", "salt_red", "salt_green",
                "salt_blue")),
            Section(topic, "grain", "Grains", "Relief that is finer than the mesh, and glints", (
                "grain_size_m", "grain_amplitude_m", "grain_patchiness", "relief", "glint_share", "glint_size_m")),
            Section(topic, "layers", "In and on the Ice", "What is in the ice and on it", (
                "bubble_share", "bubble_radius_m", "bubble_band_m", "fracture_share", "fracture_spacing_m",
                "frost_share", "frost_patch_m", "patch_raggedness", "frost_albedo", "crust_share", "crust_patch_m",
                "crust_height_m", "crust_roughness")),
            _advanced(topic, "lommel_seeliger_share", "subsurface_radius_m", "subsurface_method", "transmission",
                      "transmitted", "specular", "refractive_index"))


_ARM = ("yaw", "shoulder", "elbow", "wrist", "roll")  # its joints
SECTIONS = (
    Section("terrain", "noise", "Layers of Noise", "Fractal noise that is added to the random surface",
            ("layers",)),
    _advanced("terrain", "resolution", "slope_baseline_m", "hurst", "multifractality", "outer_scale_m", "inner_scale_m",
              "lacunarity", "variant", "regional_slope_azimuth_deg", "body_radius_m"),
    _advanced("hills", "slope_baseline_m", "hurst", "smallest_m"),
    Section("excavation", "walls", "Ground and Walls", "Strength of the ground and what becomes of the walls", (
        "cohesion_pa", "friction_deg", "density_kg_m3", "gravity_m_s2", "chips_m")),
    Section("excavation", "heap", "Heap", "Where what is dug goes", (
        "bulking", "heaped_share", "heap_side", "heap_gap_m", "clods_m", "clod_sizes")),
    Section("excavation", "layers", "Fresh Ground and Layers", "Albedo of ground that is dug open, and of its layers", (
        "fresh_albedo", "layer_thickness_m", "layer_depth_m", "layer_spacing_m", "layer_albedo")),
    _advanced("excavation", "cell_m", "jitter_m", "jitter_deg"),
    *_of_surface("surface"),
    *_of_surface("rock_surface"),
    _advanced("hapke", "b_s0", "h_s", "b_c0", "h_c", "theta_bar_range_deg", "filling_factor", "h_function", "accuracy",
              "backend"),
    Section("rocks", "shape", "Shape", "Shape, tilt and burial of each rock", (
        "family", "angularity", "elongation", "height_ratio", "tilt_deg", "burial")),
    Section("rocks", "place", "Placement", "Clusters, clear ground, rocks beyond the patch and maximum number", (
        "clustering", "cluster_blocks", "cluster_radius_m", "clear_radius_m", "beyond_px", "most")),
    _advanced("rocks", "law", "file", "power_index"),
    Section("light", "planet", "Planet", "The planet in the sky and its light", (
        "planet_elevation_deg", "planet_azimuth_deg", "planet_angular_diameter_deg", "planet_flattening",
        "planet_albedo", "planet_phase_law", "planet_face", "planet_spot_longitude_deg", "planet_rings",
        "planet_least"), switch="planet"),
    Section("light", "stars", "Stars", "Stars in the sky, which do not light the ground", ("stars_faintest_mag",),
            switch="stars"),
    Section("light", "balance", "Light at Evaluation", "Brightness of the light; changes need no new render", (
        "irradiance_band", "sun_scale", "planet_scale")),
    _advanced("light", "parent", "sun_irradiance_wm2", "sun_angular_diameter_deg", "sun_temperature_k",
              "sun_distance_m"),
    Section("rig", "lens", "Lens and Alignment", "Distortion and focus of the lens, and alignment of the eyes", (
        "principal_x_px", "principal_y_px", "distortion_k1", "distortion_k2", "distortion_p1", "distortion_p2",
        "distortion_k3", "overscan", "toe_in_deg", "focus_distance_m")),
    Section("rig", "motion", "Motion", "Motion of the cameras during the exposure", (
        "speed_right_m_s", "speed_down_m_s", "speed_forward_m_s", "turn_right_deg_s", "turn_down_deg_s", "roll_deg_s",
        "motion_exposure_s")),
    _advanced("rig", "sensor_width_mm", "heading_deg", "x_m", "y_m"),
    Section("lander", "body", "Deck and Legs", "Sizes of the lander, and frost on it", (
        "turn_deg", "deck_front_m", "deck_width_m", "deck_height_m", "pad_ahead_m", "pad_apart_m", "pad_diameter_m",
        "pad_sink_m", "frost_share")),
    Section("arm", "faults", "Faults", "Difference of each joint's real angle from the commanded angle", tuple(
        f"{name}_offset_deg" for name in _ARM)),
    Section("arm", "limits", "Limits", "Angles between which each joint can turn", tuple(
        f"{name}_{end}_deg" for name in _ARM for end in ("low", "high"))),
    Section("arm", "sizes", "Sizes", "Lengths of the arm, and its scoop", (
        "offset_m", "upper_m", "fore_m", "hand_m", "scoop_length_m",
        "scoop_width_m", "scoop_depth_m")),
    Section("sensor", "optics", "Optics", "Aperture, wavelengths and sharpness of lens and filter", (
        "f_number", "pixel_pitch_um", "transmission", "band_centre_nm", "band_width_nm", "band_weights", "psf_sigma_px",
        "veiling_glare")),
    Section("sensor", "deposits", "Deposits", "Dust or frost on the windows before the lenses", (
        "deposit_share", "deposit_mm", "deposit_window_mm", "deposit_scatter", "deposit_seed", "deposits_alike")),
    Section("sensor", "filters", "Colour Filters", "The Bayer mosaic: its filters, demosaicing and white balance", (
        "bayer_pattern", "demosaicing", "white_balance", "grey", "red_centre_nm", "red_half_width_nm", "red_efficiency",
        "green_centre_nm", "green_half_width_nm", "green_efficiency", "blue_centre_nm", "blue_half_width_nm",
        "blue_efficiency", "filter_leak", "cut_on_nm", "cut_off_nm")),
    Section("sensor", "detector", "Detector", "From photons to numbers", (
        "quantum_efficiency", "full_well_e", "gain", "bits", "black_level", "blooming")),
    Section("sensor", "noise", "Noise", "Noise of the sensor, between exposures and between pixels", (
        "read_noise_e", "shot_noise", "dark_current_e_s", "temperature_k", "dark_reference_k", "dark_doubling_k",
        "prnu", "dsnu_e", "noise_seed")),
    Section("sensor", "radiation", "Radiation", "Tracks of charged particles, as in Jupiter's belts", (
        "radiation_flux_cm2_s", "radiation_depth_um", "radiation_e_per_um")),
    _advanced("sensor", "auto_percentile", "auto_target", "bracket_stops"),
    Section("quality", "indirect", "Indirect Light", "Light between parts of the ground, baked once for many images", (
        "indirect", "direct_samples", "bake_area", "bake_samples", "bake_noise")),
    _advanced("quality", "noise_threshold", "diffuse_bounces", "walk_px", "fine_relief", "truth", "truth_by",
              "files", "half_floats", "device", "threads"),
)
#: Settings that the panel of another topic draws: the tick in a header, the plan, the matchers.
ELSEWHERE = {"rocks": ("own_surface",), "dataset": ("plan", "workers", "evaluate", "leave_running", "methods"),
             "hapke": ("w",)}
#: Settings at the top of a topic's panel if they are not the first in the table: the one that turns the others on,
#: and those that most scenes change.
FIRST = {"terrain": ("rms_slope_deg", "size_m"), "light": ("directions_from", "sun_elevation_deg", "sun_azimuth_deg")}


@cache
def main_settings(topic: str) -> tuple[str, ...]:
    """Settings that the topic's own panel draws, in order."""
    elsewhere = {key for section in SECTIONS if section.topic == topic for key in (*section.settings, section.switch)}
    first = FIRST.get(topic, ())
    elsewhere |= {*ELSEWHERE.get(topic, ()), *first}
    return (*first, *(s.key for s in TOPICS[topic].settings if s.key not in elsewhere))
