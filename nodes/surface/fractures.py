"""Fractures inside ice, seen through its surface: white veils on planes that lie deeper the further one looks in.

The view is refracted into the ice and followed to the next plane of each of three sets, so that a veil moves behind the
surface with the camera, as in real ice. A plane is open in patches. The brightness there depends on the angle: light
that meets a gap of air flatly is reflected totally. The true depth is the depth of the surface, as for all ice.

Guesses are the directions of the sets, the shapes of the patches, the brightness of a veil, and its light, which is
taken from the surface above it. Joints of glacier ice on Earth come in sets; no image shows fractures of either moon.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...physics.surfaces.fractures import gap_reflectance, sight_depth_m
from ...settings.topics.surfaces import SurfaceSettings
from ..tree.builder import Node, Socket, Tree, find_output
from ..tree.formula import Number, Vector
from .patches_and_grain import NOISE_DEVIATION, add_noise, find_threshold

#: Normals of the sets of fractures: two steep ones that cross, and one that is nearly level.
_SET_NORMALS = ((0.83, 0.52, 0.20), (-0.46, 0.87, -0.17), (0.24, -0.12, 0.963))
#: Share of the spacing within which a plane may lie; wavelengths of patches and of the bending of planes, in spacings;
#: width of the edges of patches, in standard deviations of the noise; greatest bending, in spacings.
_OFFSET_SHARE, _PATCH_LENGTH, _BEND_LENGTH, _PATCH_EDGE, _MAX_BEND = 0.9, 1.8, 2.7, 0.4, 1.5
#: Albedo of a veil, and the share of it that small steps on its faces show in all directions.
VEIL_ALBEDO, _VEIL_FACE_SHARE = 0.95, 0.3
#: Cosines between which the reflectance of a gap is linear, so that its faces are as uneven as some degrees.
_GAP_COSINES = np.linspace(0.0, 1.0, 17)
#: Smallest cosine from a plane's normal at which rays are followed.
_MIN_COSINE = 0.01


@dataclass(frozen=True)
class _View:
    """A view into the ice: the point where it enters, in spacings, its direction there, and a number that selects the
    patches."""

    place: Vector
    into: Vector
    fourth: Number


def add_fracture_share(tree: Tree, surface: SurfaceSettings, geometry: Node, fourth: float, of_rocks: bool) -> Socket:
    """Add the share of a place, as seen from the camera, that shows the veil of a fracture in the ice. Return its
    output socket."""
    view = _add_view(tree, surface, geometry, fourth, of_rocks)
    clear: Number = Number(tree, 1.0)
    for which, normal in enumerate(_SET_NORMALS):
        clear = clear * (1.0 - _add_veil(tree, surface, view, which, normal))
    # Inside a clear rock the view leaves the ice where it meets the surface again.
    outside = 1.0 - Number(tree, geometry.outputs["Backfacing"])
    return ((1.0 - clear) * outside).named("Veils").value


def _add_view(tree: Tree, surface: SurfaceSettings, geometry: Node, fourth: float, of_rocks: bool) -> _View:
    inward = tree.scaled("View", geometry.outputs["Incoming"], -1.0)
    into = tree.node(
        "ShaderNodeVectorMath",
        "View in the Ice",
        {"Vector": inward, "Vector_001": geometry.outputs["Normal"], "Scale": 1.0 / surface.refractive_index},
        operation="REFRACT",
    ).outputs[0]
    place = tree.scaled("Place in Spacings", geometry.outputs["Position"], 1.0 / surface.fracture_spacing_m)
    place = _add_bent_place(tree, place, fourth)
    if not of_rocks:
        return _View(Vector(tree, place), Vector(tree, into), Number(tree, fourth))
    # Each rock has its own planes.
    chance = tree.node("ShaderNodeObjectInfo", "Fractured Rock").outputs["Random"]
    drawn = tree.node("ShaderNodeTexWhiteNoise", "Chance of a Rock", {"W": chance}, noise_dimensions="1D")
    angles = tree.scaled("Turn of a Rock", find_output(drawn, "Color"), 2.0 * math.pi)
    turned = [
        Vector(
            tree,
            tree.node(
                "ShaderNodeVectorRotate",
                label,
                {"Vector": each, "Center": (0.0, 0.0, 0.0), "Rotation": angles},
                rotation_type="EULER_XYZ",
                invert=False,
            ).outputs[0],
        )
        for label, each in (("Place in a Rock", place), ("View in a Rock", into))
    ]
    return _View(turned[0], turned[1], Number(tree, chance) * 512.0 + fourth)


def _add_bent_place(tree: Tree, place: Socket, fourth: float) -> Socket:
    """Move a place so that planes are bent, and return its output socket. The path of the view stays straight, because
    planes bend little over one spacing."""
    field = tree.noise("Bent Planes", {"Vector": place, "W": fourth}, 1.0 / _BEND_LENGTH, 1.0).outputs["Color"]
    return tree.vector("MULTIPLY_ADD", "Bent Place", field, (_MAX_BEND,) * 3, place)


def _add_veil(tree: Tree, surface: SurfaceSettings, view: _View, which: int, normal: tuple[float, ...]) -> Number:
    """Add the share of the visible light that a veil on the next plane of a set gives."""
    across = Vector(tree, tree.combined(f"Set {which + 1}", *normal))
    slope = view.into.dot(across)
    forward = slope.exceeds(0.0) * 2.0 - 1.0
    cosine = (forward * slope).at_least(_MIN_COSINE)
    along = view.place.dot(across) + view.fourth
    cell = Number(tree, tree.math("FLOOR", "Room of a Plane", along.value))
    behind = (forward * (along - cell - _add_offset(tree, cell, which))).exceeds(0.0)
    plane = cell + behind * forward
    distance = (plane + _add_offset(tree, plane, which) - along) * forward / cosine
    along_view = tree.combined("Distance", *[distance.value] * 3)
    hit = tree.vector("MULTIPLY_ADD", "Met", view.into.socket, along_view, view.place.socket)
    field = add_noise(tree, f"Patches of Set {which + 1}", hit, _PATCH_LENGTH, (plane * 7.31 + view.fourth).value, 3.0)
    limit, edge = find_threshold(surface.fracture_share), _PATCH_EDGE * NOISE_DEVIATION
    is_open = Number(tree, tree.ramp("Open", field, limit - edge, limit + edge, smooth=True))
    gap = Number(
        tree,
        tree.curve(
            "Reflected by a Gap", cosine.value, _GAP_COSINES, gap_reflectance(_GAP_COSINES, surface.refractive_index)
        ),
    )
    seen = (distance * (-surface.fracture_spacing_m / sight_depth_m(surface))).exp()
    return is_open * seen * gap.times_plus(1.0 - _VEIL_FACE_SHARE, _VEIL_FACE_SHARE)


def _add_offset(tree: Tree, plane: Number, which: int) -> Number:
    """Add the random offset of a plane within its spacing, 0 to 1."""
    chance = tree.node(
        "ShaderNodeTexWhiteNoise", "Chance of a Plane", {"W": (plane + 1013.0 * which).value}, noise_dimensions="1D"
    ).outputs["Value"]
    return Number(tree, chance).times_plus(_OFFSET_SHARE, 0.5 - 0.5 * _OFFSET_SHARE)
