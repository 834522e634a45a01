"""The scene description: every setting there is, once.

``TOPICS`` is the only list of settings. Blender's property groups (``Scene.icymoon``), the keys of
presets and TOML files, ``--set topic.key=value``, the documentation and the provenance in
``pair.json`` are all made from it. The module imports without Blender; only ``register`` needs it.

Units are part of the names (``_m``, ``_deg``, ``_px`` …) and the number is the same everywhere:
what the sidebar shows is what the TOML file says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

Value = bool | int | float | str | list[dict[str, Any]]

#: What a change of a setting forces to be made again, dearest first. "response" only needs the
#: images to be developed again, "run" says where and how fast and changes no result.
EFFECTS = ("geometry", "material", "light", "camera", "sampling", "response", "run")


@dataclass(frozen=True)
class Setting:
    """One setting. ``minimum``/``maximum`` are what is accepted, ``soft`` is where sliders end."""

    key: str
    label: str
    default: Value
    description: str
    effect: str
    unit: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    soft: tuple[float, float] | None = None
    choices: tuple[tuple[str, str, str], ...] = ()
    subtype: str = "NONE"
    precision: int = 3
    entries: tuple[Setting, ...] = ()  # of a list of tables, the settings of each table

    @property
    def kind(self) -> str:
        """'choice', 'bool', 'int', 'float', 'text' or 'list' (of tables with ``entries``)."""
        if self.entries:
            return "list"
        if self.choices:
            return "choice"
        return {bool: "bool", int: "int", float: "float", str: "text"}[type(self.default)]


@dataclass(frozen=True)
class Topic:
    """A group of settings that is one sub-panel and one TOML table."""

    key: str
    label: str
    description: str
    settings: tuple[Setting, ...]

    def __getitem__(self, key: str) -> Setting:
        for setting in self.settings:
            if setting.key == key:
                return setting
        raise KeyError(f"{self.key}.{key}")


def _metres(key: str, label: str, default: float, low: float, high: float, soft: tuple[float, float],
            description: str, effect: str) -> Setting:
    return Setting(key, label, default, description, effect, "m", low, high, soft, subtype="DISTANCE", precision=4)


def _degrees(key: str, label: str, default: float, low: float, high: float, description: str, effect: str,
             soft: tuple[float, float] | None = None, precision: int = 2) -> Setting:
    return Setting(key, f"{label} (°)", default, description, effect, "deg", low, high, soft, precision=precision)


def _fraction(key: str, label: str, default: float, description: str, effect: str, low: float = 0.0,
              high: float = 1.0) -> Setting:
    return Setting(key, label, default, description, effect, "1", low, high, subtype="FACTOR")


TERRAIN = Topic("terrain", "Terrain", "Shape of the ground as a random surface with stated statistics", (
    _metres("size_m", "Size", 20.0, 0.01, 1.0e5, (1.0, 100.0),
            "Side of the square patch of ground, centred on the origin", "geometry"),
    Setting("resolution", "Vertices per Side", 1025,
            "Vertices along each side of the patch; their spacing is size / (vertices - 1)", "geometry",
            "vertices", 2, 4097, (65, 2049)),
    _degrees("rms_slope_deg", "Ruggedness, RMS Slope", 12.0, 0.0, 75.0,
             "Root-mean-square slope of the ground between points one slope baseline apart: "
             "about 5 for smooth plains, 10 to 15 for ridged plains, above 25 for broken ground", "geometry",
             (0.0, 45.0)),
    _metres("slope_baseline_m", "Slope Baseline", 1.0, 1.0e-3, 1.0e4, (0.1, 10.0),
            "Distance between the two points at which the ruggedness is stated", "geometry"),
    Setting("hurst", "Hurst Exponent", 0.8,
            "How roughness changes with scale: RMS deviation grows as distance to this power. "
            "Below 0.5 the slopes at centimetres become absurdly steep", "geometry", "1", 0.05, 1.0, (0.3, 1.0)),
    _fraction("multifractality", "Multifractality", 0.5,
              "0: equally rough everywhere (fractional Brownian); 1: hollows smooth, heights rough", "geometry"),
    _metres("outer_scale_m", "Largest Feature", 8.0, 1.0e-3, 1.0e5, (0.5, 50.0),
            "Wavelength of the first octave; longer swells are absent", "geometry"),
    Setting("lacunarity", "Lacunarity", 2.0, "Ratio of wavelengths of successive octaves", "geometry", "1",
            1.2, 4.0, (1.5, 3.0)),
    Setting("octaves", "Octaves", 9,
            "Number of octaves; those shorter than two vertex spacings are left out of the mesh", "geometry",
            "octaves", 1, 16, (1, 12)),
))

SURFACE = Topic("surface", "Surface", "Snow or ice that the ground is made of", (
    _fraction("albedo", "Albedo", 0.9, "Base reflectance of the grains, equal in all bands", "material"),
    _fraction("albedo_variation", "Albedo Variation", 0.0,
              "Depth of the random albedo patches as a fraction of the albedo; they only darken", "material"),
    _metres("albedo_patch_m", "Albedo Patch", 0.5, 1.0e-4, 1.0e4, (0.01, 10.0),
            "Wavelength of the albedo patches", "material"),
    _fraction("subsurface_weight", "Subsurface Weight", 0.0,
              "Share of the light that enters the snow and leaves it elsewhere (random walk); "
              "1 makes a render about five times as dear as 0", "material"),
    _metres("subsurface_radius_m", "Subsurface Radius", 0.005, 0.0, 10.0, (0.0, 0.1),
            "Mean free path of light in the snow", "material"),
    _fraction("roughness", "Roughness", 0.6, "Microfacet roughness of the specular reflection", "material"),
    _fraction("specular", "Specular Level", 0.5,
              "Strength of the specular reflection; 0.5 is what the refractive index gives", "material"),
    Setting("refractive_index", "Refractive Index", 1.31, "Of water ice in the visible: 1.31", "material", "1",
            1.0, 3.0, (1.0, 2.0)),
    _metres("grain_size_m", "Grain Size", 0.03, 1.0e-4, 1.0e3, (0.001, 1.0),
            "Wavelength of the fine relief that is finer than the mesh", "material"),
    _metres("grain_amplitude_m", "Grain Relief", 0.004, 0.0, 1.0, (0.0, 0.05),
            "Height of the fine relief; it shades the surface as bump and leaves the true depth as it is",
            "material"),
))

ROCKS = Topic("rocks", "Rocks", "Ice blocks lying on the ground", (
    _fraction("coverage", "Coverage", 0.0, "Share of the ground covered by blocks; 0 for none", "geometry",
              high=0.5),
    _metres("smallest_m", "Smallest", 0.1, 1.0e-3, 100.0, (0.02, 1.0),
            "Diameter at which the size distribution starts", "geometry"),
    _metres("largest_m", "Largest", 0.8, 1.0e-3, 100.0, (0.05, 5.0),
            "Diameter at which the size distribution ends", "geometry"),
    Setting("power_index", "Size Index", 3.0,
            "Exponent of the cumulative power law N(>D) ~ D^-index: higher means more small blocks", "geometry",
            "1", 0.5, 6.0, (1.0, 5.0)),
    _fraction("angularity", "Angularity", 0.6, "0: rounded, 1: broken ice with sharp edges", "geometry"),
    _fraction("burial", "Burial", 0.25, "Mean share of a block's height that is under the ground", "geometry",
              high=0.9),
    Setting("most", "Most", 2000,
            "Upper bound on the number of blocks; the smallest ones are left out, with a warning, to keep it",
            "geometry", "blocks", 0, 20000, (0, 5000)),
))

LIGHT = Topic("light", "Light", "The Sun as the body's sky shows it", (
    Setting("sun_irradiance_wm2", "Sun Irradiance (W/m²)", 14.82,
            "Solar irradiance on a surface facing the Sun, all wavelengths: 14.82 at Saturn, 50.26 at Jupiter "
            "(1361 W/m² / distance² in au)", "light", "W/m²", 0.0, 1.0e5, (0.0, 100.0)),
    _degrees("sun_angular_diameter_deg", "Sun Diameter", 0.0556, 0.0, 90.0,
             "Apparent diameter of the Sun's disc: 0.0556 at Saturn, 0.1024 at Jupiter; it sets the softness of "
             "shadows", "light", (0.0, 1.0), precision=4),
    _degrees("sun_elevation_deg", "Sun Elevation", 20.0, -90.0, 90.0,
             "Height of the Sun's centre above the local horizon; below 0 it is night", "light"),
    _degrees("sun_azimuth_deg", "Sun Azimuth", 60.0, -360.0, 360.0,
             "Direction of the Sun from north (+Y) over east (+X)", "light"),
))

RIG = Topic("rig", "Stereo Camera", "Two identical parallel cameras; the left one is the reference", (
    _metres("baseline_m", "Baseline", 0.25, 1.0e-4, 100.0, (0.02, 1.0),
            "Distance between the two optical centres", "camera"),
    Setting("focal_length_mm", "Focal Length", 32.0, "Focal length of both lenses", "camera", "mm", 1.0, 5000.0,
            (5.0, 200.0), subtype="DISTANCE_CAMERA"),
    Setting("sensor_width_mm", "Sensor Width", 60.0, "Width of both sensors; pixels are square", "camera", "mm",
            1.0, 100.0, (5.0, 70.0), subtype="DISTANCE_CAMERA"),
    Setting("width_px", "Width", 640, "Columns of the images", "camera", "px", 4, 16384, (64, 2048),
            subtype="PIXEL"),
    Setting("height_px", "Height", 480, "Rows of the images", "camera", "px", 4, 16384, (64, 2048),
            subtype="PIXEL"),
    _metres("height_m", "Height above Ground", 1.6, 1.0e-3, 1.0e4, (0.3, 5.0),
            "Height of the left camera above the ground beneath it", "camera"),
    _degrees("pitch_deg", "Pitch Down", 45.84, -90.0, 90.0,
             "Angle of the optical axis below the horizontal", "camera"),
    _degrees("heading_deg", "Heading", 0.0, -360.0, 360.0,
             "Direction of the optical axis from north (+Y) over east (+X)", "camera"),
    _metres("x_m", "Site East", 0.0, -5.0e4, 5.0e4, (-10.0, 10.0), "East coordinate of the left camera", "camera"),
    _metres("y_m", "Site North", 0.0, -5.0e4, 5.0e4, (-10.0, 10.0), "North coordinate of the left camera",
            "camera"),
))

SENSOR = Topic("sensor", "Camera Response",
               "From radiance to grey values; applied when images are evaluated, never needs a new render", (
    Setting("auto_exposure", "Auto Exposure", True,
            "Choose one exposure for both eyes from the brightest part of the left image", "response"),
    _fraction("auto_percentile", "Auto Percentile", 0.99,
              "Share of the pixels that the exposure target is met or undercut by", "response"),
    _fraction("auto_target", "Auto Target", 0.8,
              "Share of the full well that the percentile is exposed to", "response", low=0.01),
    Setting("saturation_radiance", "Saturation Radiance", 5.0,
            "Radiance in W/(m² sr) that fills the well when auto exposure is off", "response", "W/(m² sr)",
            1.0e-6, 1.0e6, (0.01, 100.0)),
    Setting("full_well_e", "Full Well (e-)", 20000.0, "Electrons that a pixel holds before it saturates",
            "response", "e-", 1.0, 1.0e7, (1000.0, 1.0e5), precision=0),
    Setting("read_noise_e", "Read Noise (e-)", 15.0, "Standard deviation of the noise of reading a pixel",
            "response", "e-", 0.0, 1.0e5, (0.0, 100.0), precision=1),
    Setting("shot_noise", "Shot Noise", True, "Poisson noise of the photo-electrons", "response"),
    Setting("bits", "Bits", 8, "Bits of the analogue-digital converter", "response", "bits", 8, 16),
))

QUALITY = Topic("quality", "Quality", "What a render may cost", (
    Setting("samples", "Samples", 32, "Light paths per pixel and eye", "sampling", "samples", 1, 65536, (1, 1024)),
    Setting("denoiser", "Denoiser", "NONE",
            "Applied to each eye; the truth is never touched", "sampling",
            choices=(("NONE", "None", "Leave the noise of the light paths in the images"),
                     ("OIDN", "OpenImageDenoise",
                      "Remove the noise; cheap, but smooths ice texture and so flatters stereo matchers"))),
    Setting("diffuse_bounces", "Bounces", 4,
            "Diffuse interreflections followed; 4 are within 1 % of all even at albedo 1", "sampling", "bounces",
            0, 128, (0, 16)),
    Setting("device", "Device", "CPU", "What the light paths are computed on", "run",
            choices=(("CPU", "CPU", "All processor cores"),
                     ("GPU", "GPU", "The graphics cards that Cycles can use; refused if there is none"))),
    Setting("threads", "Threads", 0, "Processor threads; 0 for all", "run", "threads", 0, 1024, (0, 64)),
))

DATASET = Topic("dataset", "Data Set", "Where pairs go and how they vary", (
    Setting("folder", "Folder", "~/icymoon",
            "Where the data set is written; ~ is your home folder, // the folder of the .blend file",
            "run", subtype="DIR_PATH"),
    Setting("seed", "Seed", 1,
            "The one seed from which terrain, blocks, grains, render noise and sensor noise are all drawn",
            "geometry", "", 0, 2147483647),
    Setting("headings", "Headings", 1,
            "Pairs rendered at the site, the rig turned by equal steps; 4 is the paper's panorama", "run",
            "pairs", 1, 360, (1, 12)),
    Setting("methods", "Matchers", "bm,sgbm", "Stereo matchers that Evaluate runs, separated by commas", "run"),
))

TOPICS: dict[str, Topic] = {t.key: t for t in (TERRAIN, SURFACE, ROCKS, LIGHT, RIG, SENSOR, QUALITY, DATASET)}


def all_settings() -> list[tuple[str, Setting]]:
    """Every (topic key, setting) in the order of the sidebar."""
    return [(topic.key, setting) for topic in TOPICS.values() for setting in topic.settings]


def _group(name: str, doc: str, annotations: dict[str, Any]) -> type:
    """Make and register a property group."""
    import bpy

    group = type(name, (bpy.types.PropertyGroup,), {"__doc__": doc, "__annotations__": annotations})
    bpy.utils.register_class(group)
    _classes.append(group)
    return group


def _blender_property(topic: str, setting: Setting) -> Any:
    import bpy

    if setting.kind == "list":
        entry = _group(f"ICYMOON_PG_{topic}_{setting.key}", setting.description,
                       {s.key: _blender_property(topic, s) for s in setting.entries})
        return bpy.props.CollectionProperty(type=entry, name=setting.label, description=setting.description)
    common: dict[str, Any] = {"name": setting.label, "description": setting.description,
                              "default": setting.default}
    if setting.kind == "bool":
        return bpy.props.BoolProperty(**common)
    if setting.kind == "choice":
        return bpy.props.EnumProperty(items=setting.choices, **common)
    if setting.kind == "text":
        from .compat import path_options
        if setting.subtype == "DIR_PATH":
            return bpy.props.StringProperty(subtype="DIR_PATH", options=path_options(), **common)
        return bpy.props.StringProperty(**common)
    low, high = setting.soft or (setting.minimum, setting.maximum)
    common |= {"min": setting.minimum, "max": setting.maximum, "soft_min": low, "soft_max": high,
               "subtype": setting.subtype}
    if setting.kind == "int":
        return bpy.props.IntProperty(**common)
    unit = {"DISTANCE": "LENGTH", "DISTANCE_CAMERA": "CAMERA"}.get(setting.subtype, "NONE")
    return bpy.props.FloatProperty(precision=setting.precision, unit=unit, **common)


_classes: list[type] = []


def register() -> None:
    """Make the property groups from ``TOPICS`` and hang them on ``Scene.icymoon``."""
    import bpy

    pointers: dict[str, Any] = {}
    for topic in TOPICS.values():
        group = _group(f"ICYMOON_PG_{topic.key}", topic.description,
                       {s.key: _blender_property(topic.key, s) for s in topic.settings})
        pointers[topic.key] = bpy.props.PointerProperty(type=group, name=topic.label,
                                                        description=topic.description)
    pointers["preset"] = bpy.props.StringProperty(name="Preset", description="The scene preset last loaded")
    root = _group("ICYMOON_PG_description", "Everything that describes an Icy Moon scene", pointers)
    bpy.types.Scene.icymoon = bpy.props.PointerProperty(
        type=root, name="Icy Moon", description="Everything that describes an Icy Moon scene")


def unregister() -> None:
    """Undo ``register``, in reverse order."""
    import bpy

    del bpy.types.Scene.icymoon
    while _classes:
        bpy.utils.unregister_class(_classes.pop())
