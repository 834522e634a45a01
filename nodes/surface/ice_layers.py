"""Layers in the ice and on it: bubbles in bands, light through clear rocks, a broken crust on snow, thin frost.

Each layer is a separate shader with its own albedo, so the albedo of a mixture is the mean by area. Where a layer
covers all or nothing, Cycles evaluates only the visible one. Layers that are switched off get no nodes.

The shapes of patches and bands, and all steepnesses here, are guesses. No image shows ice of either moon at
centimetres.
"""

from __future__ import annotations

import math
from typing import Any

from ...physics.light.bands import bubbly_ice_bands, clear_ice_absorption_1_m
from ...physics.surfaces.fallen_frost import find_free_exponent, find_hold_cosines, find_origin
from ...physics.surfaces.principled import diffuse_fresnel_reflectance
from ...settings.topics.surfaces import SurfaceSettings
from ..ground.rocks import ROCK_SHELTER, ROCK_SHELTER_SLOPE
from ..tree.builder import WHITE, Node, Socket, Tree, Value
from ..tree.formula import Number
from .patches_and_grain import (
    NOISE_DEVIATION,
    NOISE_MEAN,
    add_noise,
    add_patch_noise,
    add_share_below,
    find_threshold,
)
from .sheltered_ground import SHELTERED

#: Ratio of the share of bubbles in the whitest band to the mean, and of the mean to the bluest band; the largest share.
_BAND_CONTRAST, _MAX_BUBBLE_SHARE = 4.0, 0.6
#: Direction across the bands of the ground, as of veins that froze again; wavelength and amplitude of their bending, in
#: bands.
_ACROSS_BANDS, _BEND_LENGTH, _MAX_BEND = (0.88, 0.38, 0.28), 4.0, 3.0
#: Frost: cosines of the slopes at which it starts to decrease (30 degrees) and ends (65 degrees); the rise of the noise
#: that frost would need there, and half the width of the edge of frost, both in standard deviations.
_FULL_FROST_COSINE, _NO_FROST_COSINE, _NO_FROST_DEVIATIONS, _FROST_EDGE = 0.87, 0.42, 7.5, 1.0
#: Half the width of the edge of patches of fallen frost, as a share of the noise's values: the most and the least.
_FALLEN_EDGE, _SHARPEST_EDGE = 0.15, 1e-3
#: Crust: width of its edge in standard deviations of the noise, and the share of the grain's height that is left under
#: it.
_CRUST_EDGE = 0.05
CRUST_GRAIN = 0.15


def apply_bubble_albedo(surface: SurfaceSettings) -> SurfaceSettings:
    """Return ``surface`` settings with the albedo of their bubbles, as the mean of the bands; unchanged without
    bubbles."""
    if surface.model != "PRINCIPLED" or surface.bubble_share == 0.0:
        return surface
    bands = bubbly_ice_bands(surface.bubble_radius_m, surface.bubble_share)
    return surface | {"albedo": sum(bands) / 3, "ice_colour": "GREY"}


def add_bubbly_colour(tree: Tree, surface: SurfaceSettings, geometry: Node, fourth: float, of_rocks: bool) -> Socket:
    """Add the albedo, by band, of ice with the bubbles of ``surface`` settings, and return its output socket.

    In bands the share f of bubbles varies by equal factors up and down. The albedo A in each colour band then is a
    power of its value at the mean share, since ln A is proportional to √((1 - f) / f).
    """
    bands = bubbly_ice_bands(surface.bubble_radius_m, surface.bubble_share)
    if surface.bubble_band_m == 0.0:
        return tree.colour("Bubbly Ice", *bands)
    share = _add_bubble_share(tree, surface, geometry, fourth, of_rocks)
    mean = math.sqrt((1.0 - surface.bubble_share) / surface.bubble_share)
    exponent = ((1.0 - share) / share).sqrt() * (1.0 / mean)
    parts = (
        tree.math("POWER", f"Bubbly Ice {key}", band, exponent.value)
        for key, band in zip(("Red", "Green", "Blue"), bands, strict=True)
    )
    return tree.colour("Bubbly Ice", *parts)


def _add_bubble_share(tree: Tree, surface: SurfaceSettings, geometry: Node, fourth: float, of_rocks: bool) -> Number:
    """Add the local share of the volume in bubbles."""
    place = geometry.outputs["Position"]
    steepest = tuple(part / surface.bubble_band_m for part in _ACROSS_BANDS)
    across = tree.vector("DOT_PRODUCT", "Across the Bands", place, steepest)
    bend = Number(tree, add_noise(tree, "Bend", place, _BEND_LENGTH * surface.bubble_band_m, fourth, 1.0))
    along = Number(tree, across) + bend * (2.0 * _MAX_BEND) + math.fmod(fourth, 97.0)
    if of_rocks:  # each is a piece from elsewhere
        chance = tree.node("ShaderNodeObjectInfo", "Piece").outputs["Random"]
        along = along + Number(tree, chance) * 512.0
    band = tree.noise("Bands", {"W": along.value}, 1.0, 2.0, roughness=0.6).outputs[0]
    step = ((Number(tree, band) - NOISE_MEAN) * (1.0 / (2.0 * NOISE_DEVIATION))).at_least(-1.0).at_most(1.0)
    return ((step * math.log(_BAND_CONTRAST)).exp() * surface.bubble_share).at_most(_MAX_BUBBLE_SHARE)


def add_clear_ice(tree: Tree, surface: SurfaceSettings, normal: Socket | None) -> tuple[Any, Any]:
    """Add clear ice that light passes through, and return the sockets of its surface and its volume.

    Rays that meet it directly or through a mirror are refracted. Light for other ground passes straight through, as no
    lamp is found through a refracting surface. The surface reflects the same share of this light, to all sides, as of
    even light.
    """
    glass = tree.node(
        "ShaderNodeBsdfGlass",
        "Clear Ice",
        {"Color": WHITE, "Roughness": surface.roughness, "IOR": surface.refractive_index, "Normal": normal},
        if_present={"Weight": 0.0, "Thin Film Thickness": 0.0, "Thin Film IOR": 1.33},
        distribution="MULTI_GGX",
    ).outputs[0]
    straight = tree.transparent("Straight Through", WHITE)
    back = tree.diffuse("Reflected", WHITE)
    straight = tree.over("Straight or Reflected", diffuse_fresnel_reflectance(surface.refractive_index), straight, back)
    path = tree.node("ShaderNodeLightPath", "Clear Ice for Whom").outputs
    lighting = Number(tree, path["Is Shadow Ray"]).at_least(Number(tree, path["Is Diffuse Ray"]))
    shader = tree.over("Refracted or Straight", lighting.value, glass, straight)
    absorption = clear_ice_absorption_1_m()
    most = max(absorption)
    volume = tree.node(
        "ShaderNodeVolumeAbsorption",
        "Absorption of Pure Ice",
        {"Color": (*(1.0 - part / most for part in absorption), 1.0), "Density": most},
        if_present={"Weight": 0.0},
    ).outputs[0]
    return shader, volume


def add_frost_share(
    tree: Tree, surface: SurfaceSettings, geometry: Node, fourth: float, mask: Value = 1.0, marked: bool = False
) -> Socket:
    """Add the share of a place that is frost, and return its output socket. The share is large on level ground and on
    top of rocks, and 0 on steep faces. ``mask`` multiplies the share. ``marked`` is whether the mesh is the ground,
    which may have the attribute ``SHELTERED``; rocks may have others.
    """
    field = add_patch_noise(tree, surface, "Frost", geometry.outputs["Position"], surface.frost_patch_m, fourth)
    if surface.frost_from == "FALL":
        frosted = _add_fallen_patches(tree, _add_fallen_share(tree, surface, geometry, marked), field)
        return frosted if isinstance(mask, float) else tree.math("MULTIPLY", "Painted Frost", frosted, mask)
    upright = tree.separated("Up", geometry.outputs["True Normal"])[2]
    rise = _NO_FROST_DEVIATIONS * NOISE_DEVIATION / (_FULL_FROST_COSINE - _NO_FROST_COSINE)
    steep = (_FULL_FROST_COSINE - Number(tree, upright)).at_least(0.0) * rise
    limit, edge = find_threshold(surface.frost_share), _FROST_EDGE * NOISE_DEVIATION
    frosted = tree.ramp("Frosted", (Number(tree, field) - steep).value, limit - edge, limit + edge, smooth=True)
    return frosted if isinstance(mask, float) else tree.math("MULTIPLY", "Painted Frost", frosted, mask)


def _add_fallen_share(tree: Tree, surface: SurfaceSettings, geometry: Node, marked: bool) -> Number:
    """Add the share of ``physics.surfaces.fallen_frost.fallen_share``, as the mean over patches."""
    normal, origin = geometry.outputs["True Normal"], find_origin(surface)
    toward = Number(tree, tree.vector("DOT_PRODUCT", "Toward the Origin", normal, origin))
    received = toward.at_least(0.0) * (1.0 / origin[2])
    sheltered = tree.attribute("Sheltered", SHELTERED) if marked else _add_rock_shelter(tree, geometry)
    received = received * (1.0 - Number(tree, sheltered))
    covered = 1.0 - (received * find_free_exponent(surface)).exp()
    held = tree.ramp("Held", tree.separated("Up", normal)[2], *find_hold_cosines(surface), smooth=True)
    return Number(tree, held) * covered


def _add_rock_shelter(tree: Tree, geometry: Node) -> Socket:
    """Add the share of grains that other ground and rocks keep from a rock, see ``rays.rock_exposure``. Return its
    output socket."""
    slope = tree.attribute("Shelter's Slope", ROCK_SHELTER_SLOPE, "Vector", "INSTANCER")
    level = Number(tree, tree.attribute("Shelter's Level", ROCK_SHELTER, kind="INSTANCER"))
    rise = Number(tree, tree.vector("DOT_PRODUCT", "Rise of Shelter", slope, geometry.outputs["Position"]))
    return (level + rise).at_least(0.0).at_most(1.0).named("Sheltered by Others").value


def _add_fallen_patches(tree: Tree, share: Number, field: Socket) -> Socket:
    """Turn noise ``field`` into patches that cover a ``share`` of the area, and return their output socket. With a
    share of 1 they cover everything, with 0 nothing. Their edges are soft, but narrow enough to keep the mean."""
    edge = share.at_most(1.0 - share).at_most(_FALLEN_EDGE).at_least(_SHARPEST_EDGE)
    ahead = share.times_plus(1.0 + 2.0 * _SHARPEST_EDGE, -_SHARPEST_EDGE) - add_share_below(tree, field)
    return tree.ramp("Fallen Frost", (ahead / edge).value, -1.0, 1.0, smooth=True)


def add_crust_share(tree: Tree, surface: SurfaceSettings, geometry: Node, fourth: float) -> Socket:
    """Add the share of a place that is crust, and return its output socket: 0 or 1, with values between at the edge of
    a crust."""
    field = add_noise(tree, "Crust", geometry.outputs["Position"], surface.crust_patch_m, fourth, 5.0)
    limit, edge = find_threshold(surface.crust_share), _CRUST_EDGE * NOISE_DEVIATION
    return tree.ramp("Crusted", field, limit - edge, limit + edge)


def smooth_under_crust(tree: Tree, crusted: Socket, height: Socket | None) -> Socket | None:
    """Lower a height of fine relief under a crust, and return its output socket; None without relief."""
    if height is None:
        return None
    return (Number(tree, height) * (1.0 - Number(tree, crusted) * (1.0 - CRUST_GRAIN))).value


def add_crust_height(tree: Tree, surface: SurfaceSettings, crusted: Socket) -> Socket:
    """Add the height in metres of a crust above the snow beside it, and return its output socket."""
    return (Number(tree, crusted) * surface.crust_height_m).value
