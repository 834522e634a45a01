"""The albedo of ground that was dug open: fresh ice, and layers at stated depths under the untouched surface."""

from __future__ import annotations

from ...settings.topics.excavation import ExcavationSettings
from ..ground.dug_ground import DEPTH, SPOIL
from ..tree.builder import Socket, Tree
from ..tree.formula import Number

#: Depths in metres between which ground becomes fresh.
_SURFACE_M, _FRESH_M = 2.0e-4, 1.0e-3


def is_shown(excavation: ExcavationSettings) -> bool:
    """Return whether ground that was dug open has another albedo than the surface anywhere."""
    return bool(excavation.fresh_albedo != 1.0 or excavation.layer_thickness_m > 0.0)


def find_darkest_layer(excavation: ExcavationSettings) -> float:
    """Find the least factor that ``add_dug_brightness`` gives."""
    layer = excavation.layer_albedo if excavation.layer_thickness_m > 0.0 else 1.0
    return float(min(excavation.fresh_albedo, layer, 1.0))


def add_dug_brightness(tree: Tree, excavation: ExcavationSettings) -> Socket:
    """Add the factor on the albedo of ground that was dug open, and return its output socket. The mesh has the
    attributes ``DEPTH`` and ``SPOIL``.

    Depth changes evenly along a wall, however few vertices it has, so layers have sharp edges on it. Spoil is a mixture
    and has the albedo of fresh ground.
    """
    depth, spoil = tree.attribute("Depth", DEPTH), tree.attribute("Spoil", SPOIL)
    fresh = tree.ramp("Dug Open", depth, _SURFACE_M, _FRESH_M)
    level: Number = Number(tree, excavation.fresh_albedo)
    if excavation.layer_thickness_m > 0.0:
        level = level + Number(tree, _add_layer(tree, excavation, depth)) * (
            excavation.layer_albedo - excavation.fresh_albedo
        )
    ground = (level - 1.0) * Number(tree, fresh) + 1.0
    return (ground + (Number(tree, excavation.fresh_albedo) - ground) * Number(tree, spoil)).named("Dug").value


def _add_layer(tree: Tree, excavation: ExcavationSettings, depth: Socket) -> Socket:
    """Add an output socket that is 1 in a layer and 0 elsewhere."""
    below = tree.math("SUBTRACT", "Below the First Top", depth, excavation.layer_depth_m)
    reached = tree.math("GREATER_THAN", "Deep Enough", below, 0.0)
    spacing = max(excavation.layer_spacing_m, excavation.layer_thickness_m) if excavation.layer_spacing_m > 0 else 0.0
    if spacing > 0.0:
        below = tree.math("FLOORED_MODULO", "Below Its Top", below, spacing)
    thin = tree.math("LESS_THAN", "In the Layer", below, excavation.layer_thickness_m)
    return tree.math("MULTIPLY", "Layer", reached, thin)
