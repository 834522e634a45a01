"""Which settings have an effect, given the other settings.

A setting that a choice rules out is hidden, and so is the exposure that is not used. Any other that a number or a tick
turns off is grey: fields must not move while the user drags a number.
"""

from __future__ import annotations

from typing import Any

from ..physics.camera.blur import MOTION
from ..physics.surfaces.textures import uses_uv
from ..settings.table import LANDFORMS, TOPICS
from ..typed_settings import TexturesSettings

_PRINCIPLED_ONLY = {"subsurface_weight", "subsurface_radius_m", "subsurface_method", "transmission", "roughness",
                    "specular", "refractive_index", "transmitted", "glint_share", "glint_size_m", "bubble_share",
                    "bubble_radius_m", "bubble_band_m", "fracture_share", "fracture_spacing_m", "frost_share",
                    "frost_patch_m", "frost_albedo", "crust_share", "crust_patch_m", "crust_height_m",
                    "crust_roughness"}
#: Surface settings, and the setting that must be above 0 for them to have an effect.
_SURFACE_NEEDS = {"albedo_patch_m": "albedo_variation", "subsurface_radius_m": "subsurface_weight",
                  "subsurface_method": "subsurface_weight",
                  "grain_size_m": "grain_amplitude_m", "relief": "grain_amplitude_m",
                  "grain_patchiness": "grain_amplitude_m", "glint_size_m": "glint_share",
                  "transmitted": "transmission", "bubble_radius_m": "bubble_share", "bubble_band_m": "bubble_share",
                  "fracture_spacing_m": "fracture_share", "frost_patch_m": "frost_share",
                  "frost_albedo": "frost_share", "crust_patch_m": "crust_share", "crust_height_m": "crust_share",
                  "crust_roughness": "crust_share",
                  **{f"salt_{key}": "salt_share" for key in ("patch_m", "red", "green", "blue")}, "salt": "salt_share"}
_MONOCHROME_ONLY = {"band_centre_nm", "band_width_nm", "band_weights", "quantum_efficiency"}
_MOSAIC_ONLY = {"bayer_pattern", "demosaicing", "white_balance", "grey", "filter_leak", "cut_on_nm", "cut_off_nm",
                *(f"{colour}_{key}" for colour in ("red", "green", "blue")
                  for key in ("centre_nm", "half_width_nm", "efficiency"))}
#: Settings of the exposure, and whether it must be automatic for them to have an effect.
_EXPOSURES = {"auto_percentile": True, "auto_target": True, "exposure_s": False}
#: Reflectance laws that use ``quality.fine_relief``.
_WITH_NORMAL = ("LAMBERT", "PRINCIPLED")
#: Settings of rocks, and the laws of sizes that use them.
_ROCK_LAWS = {"power_index": ("POWER",), "file": ("TABLE",),
              **dict.fromkeys(("smallest_m", "largest_m", "clustering", "cluster_blocks", "cluster_radius_m"),
                              ("POWER", "GOLOMBEK"))}
_SKY_ANGLES = ("_elevation_deg", "_azimuth_deg", "_diameter_deg", "_wm2", "_flattening")


def is_shown(topic: str, key: str, root: Any) -> bool:
    """Whether the present choices use a setting; ``root`` is ``Scene.icymoon``."""
    group = getattr(root, topic)
    if topic == "terrain":
        return _is_terrain_shown(key, root)
    if TOPICS[topic].parent == LANDFORMS:
        return uses_landforms(root)
    if topic in ("lander", "arm"):
        own = root.lander.kind == "OWN"
        if (topic, key) == ("lander", "kind") or root.lander.kind == "NONE":
            return key == "kind"
        if topic == "lander":
            return own or key not in ("file", "joints")
        return not own or key in ("shoulder_x_m", "shoulder_y_m", "shoulder_z_m")
    if topic == "excavation":
        only = {"file": ("RECORDED", "JOINTS"), "radius_m": ("ARC",),
                **dict.fromkeys(("start_x_m", "start_y_m", "heading_deg", "length_m", "bite_m"), ("LINE", "ARC"))}
        return bool(key == "path" or (group.path != "NONE" and group.path in only.get(key, (group.path,))))
    if topic == "mesh":
        return bool(key == "kind" or group.kind == "GRADED")
    if topic == "hills" or (topic, key) == ("rocks", "beyond_px"):
        return bool(root.source.kind == "PROCEDURAL" and root.mesh.kind == "GRADED"
                    and (topic == "hills" or group.law != "TABLE"))
    if topic == "source" and key != "kind":
        meshes = ("MESH", "STAND_IN")
        only = {"scale": meshes, "up_axis": meshes, "repair": meshes, "metres_per_pixel": ("HEIGHT_MAP",),
                "height_scale_m": ("HEIGHT_MAP",), "missing": ("HEIGHT_MAP",), "stand_in": ("STAND_IN",),
                "file": ("MESH", "HEIGHT_MAP")}
        return bool(group.kind in only[key] if key in only else group.kind != "PROCEDURAL")
    if topic in ("surface", "rock_surface"):
        models = {"snow_grain_m": group.ice_colour == "SNOW",
                  **dict.fromkeys(("salt_red", "salt_green", "salt_blue"), group.salt == "OWN"),
                  "patch_raggedness": group.model == "PRINCIPLED" or group.dirt != "BLACK",
                  "albedo": group.model != "HAPKE", "lommel_seeliger_share": group.model == "LUNAR_LAMBERT"}
        return models.get(key, key not in _PRINCIPLED_ONLY or group.model == "PRINCIPLED")
    if topic == "sensor" and key in _EXPOSURES:
        return bool(_EXPOSURES[key] == group.auto_exposure)
    if topic == "sensor":
        return key not in (_MOSAIC_ONLY if group.colour == "MONO" else _MONOCHROME_ONLY)
    if topic == "textures" and key != "set":
        if key == "stand_in":
            return bool(group.set == "STAND_IN")
        return bool(group.set == "OWN" if key.endswith("_file") else group.set != "NONE")
    if topic == "light":
        return _is_light_shown(key, group)
    if topic == "rocks" and key in _ROCK_LAWS:
        return group.law in _ROCK_LAWS[key]
    if topic == "dataset" and key == "plan":
        return str(group.plan).endswith(".toml")  # the button shows the title of a shipped plan
    if topic == "quality" and key in ("direct_samples", "bake_area", "bake_samples", "bake_noise"):
        return bool(group.indirect != "TRACED")
    if topic == "quality" and key == "fine_relief":
        return root.surface.model in _WITH_NORMAL or bool(root.rocks.own_surface
                                                          and root.rock_surface.model in _WITH_NORMAL)
    return True


def uses_landforms(root: Any) -> bool:
    """Whether the ground can have landforms and layers of noise, which are heights above a map and not above a mesh."""
    return bool(root.source.kind == "PROCEDURAL" or (root.source.kind == "HEIGHT_MAP" and root.source.detail))


def _is_terrain_shown(key: str, root: Any) -> bool:
    source = root.source
    if key == "layers" and not uses_landforms(root):
        return False
    graded = source.kind == "PROCEDURAL" and root.mesh.kind == "GRADED"
    return bool((source.kind == "PROCEDURAL" and key != ("resolution" if graded else "body_radius_m"))
                or (source.kind != "PROCEDURAL" and source.detail and key != "body_radius_m")
                or (source.kind == "HEIGHT_MAP" and key in ("size_m", "resolution")))


def _is_light_shown(key: str, group: Any) -> bool:
    """Angles are hidden if a date determines them."""
    dated = group.directions_from != "ANGLES"
    if key in ("body", "date_utc", "longitude_deg"):
        return dated
    if key in ("parent", "kernels"):
        return bool(group.directions_from == "KERNELS")
    return not (dated and key.endswith(_SKY_ANGLES))


def has_effect(topic: str, key: str, root: Any) -> bool:
    """Whether a setting that is shown has an effect, given the present numbers and ticks."""
    group = getattr(root, topic)
    if topic == "hills" or TOPICS[topic].parent == LANDFORMS:
        # The first setting of a landform, its height, slope, depth or coverage, turns it on.
        first = TOPICS[topic].settings[0].key
        return key == first or getattr(group, first) > 0
    if topic == "excavation" and key in ("layer_depth_m", "layer_spacing_m", "layer_albedo"):
        return bool(group.layer_thickness_m > 0)
    if topic == "excavation" and key == "clod_sizes":
        return bool(group.clods_m > 0)
    if topic == "rocks" and key != "coverage":
        return bool(group.coverage > 0
                    and (key not in ("cluster_blocks", "cluster_radius_m") or group.clustering > 0))
    if topic in ("surface", "rock_surface") and key in ("dirt", "dirt_patch_m"):
        # Rocks have no troughs.
        dirty = group.slope_dirt != 0 or (topic == "surface" and group.trough_dirt != 0)
        return bool(dirty and (key == "dirt" or group.dirt != "BLACK"))
    if topic in ("surface", "rock_surface") and key == "patch_raggedness":
        return bool((group.model == "PRINCIPLED" and group.frost_share > 0)
                    or (group.dirt != "BLACK" and group.dirt_patch_m > 0))
    if topic in ("surface", "rock_surface"):
        if key in ("albedo", "ice_colour", "snow_grain_m") and group.model == "PRINCIPLED" and group.bubble_share > 0:
            return False  # they follow from the bubbles
        return bool(key not in _SURFACE_NEEDS or getattr(group, _SURFACE_NEEDS[key]) > 0)
    if topic == "textures" and key in ("width_m", "repeat"):
        return group.mapping != "PATCH" and not uses_uv(TexturesSettings(set=group.set, mapping=group.mapping))
    if topic == "textures" and key != "set":
        return bool(key.endswith("_file") or group.set != "MESH")
    if topic == "workspace":
        return bool(key == "cell_m" or group.cell_m > 0)
    return _HAS_EFFECT.get(topic, _always)(key, group)


def _always(key: str, group: Any) -> bool:
    return True


def _hapke_has_effect(key: str, group: Any) -> bool:
    off = {"c": group.b == 0.0, "h_s": group.b_s0 == 0.0, "h_c": group.b_c0 == 0.0,
           "accuracy": group.backend == "NODES"}
    return not off.get(key, False)


def _light_has_effect(key: str, group: Any) -> bool:
    if key == "stars_faintest_mag":
        return bool(group.stars)
    if key == "latitude_deg":
        return bool(group.directions_from != "ANGLES" or group.planet or group.stars)
    return bool(not key.startswith("planet_") or group.planet)


def _sensor_has_effect(key: str, group: Any) -> bool:
    on = {"bracket_stops": group.brackets > 1,
          "radiation_depth_um": group.radiation_flux_cm2_s > 0, "radiation_e_per_um": group.radiation_flux_cm2_s > 0}
    return bool(on.get(key, True))


def _rig_has_effect(key: str, group: Any) -> bool:
    return key != "motion_exposure_s" or any(getattr(group, moving) != 0 for moving in MOTION)


_HAS_EFFECT = {"hapke": _hapke_has_effect, "light": _light_has_effect,
               "sensor": _sensor_has_effect, "rig": _rig_has_effect}
