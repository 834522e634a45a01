"""The colour of the ground: the colour of its ice, with salts and dirt mixed by area.

Each pixel of ground is a share of ice, of salt and of dirt side by side, so reflectances add up by their shares. A
colour here is a factor (R, G, B) on the albedo of clean ice, in the bands of ``physics.light.bands``. Materials that
the settings switch off get no nodes.
"""

from __future__ import annotations

from typing import Any

from ...physics.light.bands import material_bands
from ...physics.light.ground_colours import clean_albedo, ice_tint, salt_colour
from ...settings.topics.scene import Settings
from ...settings.topics.surfaces import SurfaceSettings
from ..tree.builder import Node, Socket, Tree, Triple, Value
from ..tree.formula import Number
from .patches_and_grain import add_clean_share, add_stained_share

_WHITE_RGB = (1.0, 1.0, 1.0)
#: Distance of the fields of dirt and of salt in the fourth dimension of noise, in units that no scene repeats.
_BESIDE_SALT = 2000.0


def is_grey(surface: SurfaceSettings) -> bool:
    """Return whether the ground has no colour, even where dirt may lie."""
    dirty = surface.dirt != "BLACK" and (surface.trough_dirt != 0.0 or surface.slope_dirt != 0.0)
    return bool(surface.ice_colour == "GREY" and surface.salt_share == 0.0 and not dirty)


def add_salt_share(
    tree: Tree,
    surface: SurfaceSettings,
    geometry: Node,
    salt_at: float,
    elevated: bool,
    frosted: Socket | None,
    dirt_mask: Value = 1.0,
) -> Value:
    """Add the local share of salt in the visible surface: an output socket, or 0.0 without salts.

    Dirt lies on salt, and frost on both; ``frosted`` is an output socket of the share of frost, or None. For the other
    arguments see ``add_ground_colour``.
    """
    if surface.salt_share == 0.0:
        return 0.0
    share = Number(tree, add_stained_share(tree, surface, geometry, salt_at))
    clean: Any = 1.0
    if surface.dirt != "BLACK":
        clean = add_clean_share(tree, surface, geometry, salt_at + _BESIDE_SALT, elevated, dirt_mask)
    if clean != 1.0:
        share = share * Number(tree, clean)
    return (share if frosted is None else share * (1.0 - Number(tree, frosted))).value


def add_ground_colour(
    tree: Tree,
    surface: SurfaceSettings,
    geometry: Node,
    salt_at: float,
    elevated: bool,
    settings: Settings | None,
    ice: Socket | None = None,
    dirt_mask: Value = 1.0,
) -> Socket | None:
    """Add the colour of the ground and return its output socket; None for grey, clean ice.

    ``salt_at`` selects the fields of salt and of patches of dirt, ``elevated`` is whether the mesh has the attribute
    ``ELEVATION``. Hapke's law needs the ``settings`` of the whole scene. ``ice`` is an output socket of the reflectance
    of clean ice by band, if that varies from place to place; then the colour is a reflectance too. ``dirt_mask``
    multiplies the dirt.
    """
    if is_grey(surface):
        return ice
    albedo = clean_albedo(surface, settings.hapke if settings is not None else None) if ice is None else 1.0
    tint: Triple = ice_tint(surface, albedo) if ice is None else ice
    colour: Triple | None = None if tint == _WHITE_RGB else tint
    if surface.salt_share > 0.0:
        stained = add_stained_share(tree, surface, geometry, salt_at)
        salt: Triple = salt_colour(surface, albedo)
        if ice is not None and surface.salt == "OWN":  # a factor on the ice
            salt = tree.vector("MULTIPLY", "Salt on Ice", ice, salt)
        colour = _add_mix(tree, "Salt Colour", stained, tint, salt)
    clean: Value = 1.0
    if surface.dirt != "BLACK":
        clean = add_clean_share(tree, surface, geometry, salt_at + _BESIDE_SALT, elevated, dirt_mask)
    if clean != 1.0:
        dirt = _divide_by_albedo(material_bands(surface.dirt), albedo)
        return _add_mix(tree, "Dirt Colour", clean, dirt, tint if colour is None else colour)
    if isinstance(colour, tuple):
        return tree.combined("Ice Colour", *colour)
    return colour


def _divide_by_albedo(bands: tuple[float, float, float], albedo: float) -> tuple[float, float, float]:
    red, green, blue = (band / albedo for band in bands)
    return red, green, blue


def _add_mix(tree: Tree, label: str, share: Value, a: Triple, b: Triple) -> Socket:
    """Mix two colours, ``b`` in this ``share`` of the area and ``a`` in the rest, and return the output socket."""
    a, b = ((*colour, 1.0) if isinstance(colour, tuple) else colour for colour in (a, b))
    return tree.mixed(label, share, a, b)
