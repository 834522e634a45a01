"""Variation of the ice from place to place: dark patches, dirty troughs and slopes, salt, grains.

Patches and black dirt darken clean ice. Salt and dirt of a material have a colour, see ``dirt_and_salt_colour``.
Effects that are switched off get no nodes.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from typing import Any

import bpy
import numpy as np

from ...physics.mesh.finer_in_view import CARRIED_SPACING, OCTAVES
from ...physics.mesh.local_heights import measure_local_heights
from ...physics.scene_requirements import needs_elevation
from ...settings.topics.surfaces import SurfaceSettings
from ...support.arrays import Array
from ...support.labels import FACE_ATTRIBUTE
from ..ground.terrain_mesh import SPACING
from ..tree.builder import Node, Socket, Tree, Value, find_output
from ..tree.formula import Number

ELEVATION = "icymoon_elevation"  # attribute: height above mean plane or surroundings in standard deviations
#: Mean and standard deviation of Blender's normalised noise of four octaves, and the width of a stain's edge.
NOISE_MEAN, NOISE_DEVIATION, _STAIN_EDGE = 0.5, 0.069, 0.02
#: Standard deviation for stains of the user's own colour. It is too large: these stains cover about 0.6 of a small
#: share that is asked for. The value stays, because pairs with such stains must not change.
_DEVIATION_OF_OWN_SALT = 0.093
#: Largest offset of a field of grain from the origin on each axis, in wavelengths. There, single precision rounds to
#: 1e-6 wavelengths. With 500 pixels for each wavelength, a tenth of a pixel is 2e-4 of it, so slopes are right within
#: 1 %.
GRAIN_FARTHEST = 32.0
#: Factor that gives three-dimensional noise the RMS heights (0.068) and slopes (0.33) of four-dimensional noise, both
#: within 5 %. Without it they are 0.080 and 0.36 at a wavelength of 1.
_GRAIN_SPAN = 0.88
#: Normal of the mirror, z - (1, 1, 1) / 3^0.5, that maps level ground to a plane with equal parts of all three axes
#: of the noise's lattice. In a plane along two axes, the lattice would be visible as a weave.
_OFF_LATTICE = (-(3**-0.5), -(3**-0.5), 1.0 - 3**-0.5)
#: Longest wavelength of patches of grain, in wavelengths of the grain.
_MAX_PATCH_LENGTH = 16.0
_STEEP_SLOPE = 1.0 - math.cos(math.radians(45.0))
#: Wavelength of the ragged part of patches, in wavelengths of the patches.
_RAGGED_LENGTH = 0.125
#: Elevations are limited to this many standard deviations.
_MAX_ELEVATION = 3.0


def add_noise(tree: Tree, label: str, where: Socket, wavelength_m: float, fourth: float, octaves: float) -> Socket:
    """Output socket of Blender's noise, around 0.5, with a longest wavelength. ``fourth`` selects the field."""
    return tree.noise(label, {"Vector": where, "W": fourth}, 1.0 / wavelength_m, octaves).outputs[0]


def add_patchy_grain(
    tree: Tree, surface: SurfaceSettings, where: Socket, place: Sequence[float], height: Socket
) -> Socket:
    """Add grain whose height varies in patches, with unchanged RMS height; return its output socket.

    The factor is log-normal, as in a multiplicative cascade: exp(s g - s²) with Gaussian noise g of unit deviation has
    a mean square of 1. Its patches are 2 to ``_MAX_PATCH_LENGTH`` wavelengths of the grain wide. With a limit of c
    deviations, g stays within -c and c, and the factor is exp(s g - b) with the same mean square.
    """
    if surface.grain_patchiness == 0.0:
        return height
    field = add_noise(tree, "Patches of Grain", where, _MAX_PATCH_LENGTH * surface.grain_size_m, place[0], 4.0)
    deviations = Number(tree, field).times_plus(1 / NOISE_DEVIATION, -NOISE_MEAN / NOISE_DEVIATION)
    s, limit = float(surface.grain_patchiness), float(surface.grain_patch_limit)
    shift = -s * s
    if limit > 0.0:
        deviations = deviations.at_least(-limit).at_most(limit)
        shift = -0.5 * math.log(measure_limited_patches(s, limit))
    share = (deviations * s + shift).exp().named("Share of Grain")
    return (Number(tree, height) * share).value


def measure_limited_patches(patchiness: float, limit: float) -> float:
    """Mean of exp(2 s g) for a Gaussian g of unit deviation that is clipped at -limit and limit.

    Between the limits it is the integral of exp(2 s g) times the density of g, a Gaussian about 2 s; the tails add what
    is at the limits.
    """
    s, below = patchiness, statistics.NormalDist().cdf
    inside = math.exp(2.0 * s * s) * (below(limit - 2.0 * s) - below(-limit - 2.0 * s))
    return inside + below(-limit) * 2.0 * math.cosh(2.0 * s * limit)


def add_grain(tree: Tree, where: Socket, wavelength_m: float, place: Sequence[float]) -> Socket:
    """Output socket of the height of grain, around 0, with a longest wavelength.

    ``place`` (3), in wavelengths, is the offset in the noise that selects the field. It must be at most
    ``GRAIN_FARTHEST``, since bump uses differences over a tenth of a pixel. Bump evaluates the noise three times at
    every hit, so the noise has three dimensions, which take half as long as four.
    """
    askew = _add_grain_place(tree, where, wavelength_m, place)
    field = tree.noise("Grain", {"Vector": askew}, 1.0, OCTAVES - 1.0).outputs[0]
    centred = tree.math("SUBTRACT", "Grain About 0", field, NOISE_MEAN)
    return tree.math("MULTIPLY", "Grain of Span 1", centred, _GRAIN_SPAN)


def _add_grain_place(tree: Tree, where: Socket, wavelength_m: float, place: Sequence[float]) -> Socket:
    """Output socket of the place in the noise, in wavelengths, askew to its lattice."""
    shifted = tree.vector("MULTIPLY_ADD", "Grain Place", where, (1.0 / wavelength_m,) * 3, place)
    return tree.vector("REFLECT", "Off the Lattice", shifted, _OFF_LATTICE)


def add_grain_by_fineness(
    tree: Tree, surface: SurfaceSettings, where: Socket, place: Sequence[float]
) -> tuple[Any, Any]:
    """Output sockets of the heights in metres of the grain that the vertices carry, and of the finer rest.

    Their sum is ``add_grain`` times the amplitude, octave by octave. The mesh has the attribute ``SPACING``. Only one
    octave can be carried in part. All longer octaves are carried and form one fractal. All shorter octaves are bump and
    form another. So each hit looks up only the octaves that are bump there.
    """
    askew = _add_grain_place(tree, where, surface.grain_size_m, place)
    spacing = Number(tree, tree.attribute("Vertex Spacing", SPACING))
    first = _find_partly_carried(surface, spacing)
    part_scale = Number(tree, 2.0).power(first).named("Scale of the Octave in Part")
    waves = spacing * part_scale * (1.0 / surface.grain_size_m)
    share = Number(tree, tree.ramp("Carried of It", waves.value, 1.0, CARRIED_SPACING))
    partly = _add_octaves(tree, "Octave in Part", askew, part_scale, 0.0)
    shorter = _add_octaves(tree, "Shorter Octaves", askew, part_scale * 2.0, OCTAVES - 2.0 - first)
    longer = _add_octaves(tree, "Longer Octaves", askew, 1.0, first - 1.0)
    # The factor of an octave without normalization is half of that with it.
    span = 0.5 * _GRAIN_SPAN * surface.grain_amplitude_m / (2.0 - 0.5 ** (OCTAVES - 1))
    some_shorter, some_longer = (OCTAVES - 1.0 - first).at_most(1.0), first.at_most(1.0)
    rest = ((1.0 - share) * partly + 0.5 * some_shorter * shorter) / part_scale * span
    carried = (share * partly / part_scale + some_longer * longer) * span
    return add_patchy_grain(tree, surface, where, place, carried.value), add_patchy_grain(
        tree, surface, where, place, rest.value
    )


def _find_partly_carried(surface: SurfaceSettings, spacing: Number) -> Number:
    """Find the longest octave, from 0, that the vertices do not carry fully; the last octave if they carry all."""
    whole = 1.0 - (spacing.at_least(1e-9) / (CARRIED_SPACING * surface.grain_size_m)).log() * (1.0 / math.log(2.0))
    carried = Number(spacing.tree, spacing.tree.math("FLOOR", "Octaves Carried", whole.value))
    return carried.at_least(0.0).at_most(OCTAVES - 1.0)


def _add_octaves(tree: Tree, label: str, where: Socket, scale: Number | float, detail: Number | float) -> Number:
    """The sum of ``detail`` + 1 octaves of noise, the first with a span of about 2 and each next one with half as
    much."""
    scale, detail = (each.value if isinstance(each, Number) else each for each in (scale, detail))
    return Number(tree, tree.noise(label, {"Vector": where}, scale, detail, normalize=False).outputs[0])


def mark_elevation(
    mesh: bpy.types.Mesh, surface: SurfaceSettings, drop_m: Callable[[Array, Array], Array] | None = None
) -> None:
    """Set the attribute ``ELEVATION`` of a mesh if ``surface`` settings need it; otherwise remove it.

    It is the height of vertices above the mean plane, or above the mean of their surroundings, in standard deviations.
    ``drop_m`` returns by how many metres curved ground drops at coordinates.
    """
    existing = mesh.attributes.get(ELEVATION)
    if not needs_elevation(surface):
        if existing is not None:
            mesh.attributes.remove(existing)
        return
    position = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", position)
    x, y, z = position.reshape(-1, 3).T.astype(np.float64)
    if drop_m is not None:
        z = z + drop_m(x, y)
    plane = np.stack([x, y, np.ones_like(x)], axis=1)
    above = z - plane @ np.linalg.lstsq(plane, z, rcond=None)[0]
    known = np.ones(len(above), bool)
    if surface.trough_width_m > 0.0:
        above, known = measure_local_heights(x, y, above, float(surface.trough_width_m))
    deviation = float(above[known].std())
    elevation = above / deviation if deviation > 0.0 else above
    attribute = existing or mesh.attributes.new(ELEVATION, "FLOAT", "POINT")
    attribute.data.foreach_set("value", np.clip(elevation, -_MAX_ELEVATION, _MAX_ELEVATION).astype(np.float32))


def _add_undimmed_share(tree: Tree, label: str, share: Value, dirt: float) -> Value:
    """Output socket of 1 - dirt x share."""
    return tree.math("SUBTRACT", f"{label} Kept", 1.0, tree.math("MULTIPLY", f"{label} Darkening", share, dirt))


def add_brightness(
    tree: Tree, surface: SurfaceSettings, geometry: Node, fourth: float, elevated: bool, mask: Value = 1.0
) -> Value:
    """Grey factor on the albedo of clean ice: an output socket, or 1.0 if nothing darkens it.

    ``elevated`` is whether the mesh has the attribute ``ELEVATION``, which rocks do not have. ``mask`` multiplies the
    dirt.
    """
    factors: list[Any] = []
    if surface.albedo_variation > 0.0:
        patches = add_noise(tree, "Patches", geometry.outputs["Position"], surface.albedo_patch_m, fourth, 4.0)
        factors.append(_add_undimmed_share(tree, "Patches", patches, surface.albedo_variation))
    if surface.dirt == "BLACK":
        factors += _find_clean_shares(tree, surface, geometry, elevated, mask)
    return _add_factors(tree, "Brightness", factors)


def add_patch_noise(
    tree: Tree, surface: SurfaceSettings, label: str, where: Socket, wavelength_m: float, fourth: float
) -> Socket:
    """Output socket of noise for patches, of mean ``NOISE_MEAN`` and deviation ``NOISE_DEVIATION``.

    A share ``patch_raggedness`` of its variance has ``_RAGGED_LENGTH`` of the wavelength and less: the edges of patches
    then break up into small patches, as frost and dust between grains do.
    """
    field = add_noise(tree, label, where, wavelength_m, fourth, 4.0)
    if surface.patch_raggedness == 0.0:
        return field
    fine = add_noise(tree, f"{label}, Ragged", where, _RAGGED_LENGTH * wavelength_m, fourth + 0.5, 4.0)
    long, short = (math.sqrt(share) for share in (1.0 - surface.patch_raggedness, surface.patch_raggedness))
    both = Number(tree, field) * long + Number(tree, fine) * short
    return (both + NOISE_MEAN * (1.0 - long - short)).named(f"{label}, Both").value


def add_clean_share(
    tree: Tree, surface: SurfaceSettings, geometry: Node, fourth: float, elevated: bool, mask: Value = 1.0
) -> Value:
    """Share of the area that dirt of a material leaves free: an output socket, or 1.0 if there is no dirt.

    With patches of dirt it is 0 in them and 1 between them, and they take up the dirt's share of the area. ``fourth``
    selects their field, and ``mask`` multiplies the dirt.
    """
    clean = _add_factors(tree, "Clean Share", _find_clean_shares(tree, surface, geometry, elevated, mask))
    if clean == 1.0 or surface.dirt_patch_m == 0.0:
        return clean
    field = add_patch_noise(tree, surface, "Dirt Patches", geometry.outputs["Position"], surface.dirt_patch_m, fourth)
    below = add_share_below(tree, field)
    # With soft edges all of the ground is still free at 1, and none at 0.
    ahead = Number(tree, clean).times_plus(1 + 2 * _STAIN_EDGE, -_STAIN_EDGE) - below
    return tree.ramp("Between Patches", ahead.value, -_STAIN_EDGE, _STAIN_EDGE, smooth=True)


def add_share_below(tree: Tree, field: Socket) -> Number:
    """Add the share of noise that is below its value here, from the output socket ``field`` of noise."""
    # A logistic function is within 0.01 of the Gaussian's.
    deviations = Number(tree, field).times_plus(1 / NOISE_DEVIATION, -NOISE_MEAN / NOISE_DEVIATION)
    return (1.0 / ((deviations * -1.702).exp() + 1.0)).named("Share of Noise Below")


def _add_factors(tree: Tree, label: str, factors: Sequence[Any]) -> Value:
    product: Value = 1.0
    for k, factor in enumerate(factors):
        product = factor if k == 0 else tree.math("MULTIPLY", label, product, factor)
    return product


def _find_clean_shares(tree: Tree, surface: SurfaceSettings, geometry: Node, elevated: bool, mask: Value) -> list[Any]:
    """Output sockets of the shares of the area that dirt in troughs and dirt on slopes leave free."""
    factors: list[Any] = []
    if surface.trough_dirt != 0.0 and elevated:
        height = tree.attribute("Elevation", ELEVATION)
        clean = math.copysign(1.0, surface.trough_dirt)
        troughs = _add_masked(tree, "Troughs", tree.ramp("Trough Share", height, clean, -clean), mask)
        factors.append(_add_undimmed_share(tree, "Trough", troughs, abs(surface.trough_dirt)))
    if surface.slope_dirt != 0.0:
        upright = tree.separated("Upright", geometry.outputs["True Normal"])[2]
        ends = (1.0, 1.0 - _STEEP_SLOPE) if surface.slope_dirt > 0 else (1.0 - _STEEP_SLOPE, 1.0)
        slopes = _add_masked(tree, "Slopes", tree.ramp("Slope Share", upright, *ends), mask)
        factors.append(_add_undimmed_share(tree, "Slope", slopes, abs(surface.slope_dirt)))
    return factors


def _add_masked(tree: Tree, label: str, share: Socket, mask: Value) -> Value:
    """Output socket of a share times a painted mask; the share itself without a mask."""
    return share if isinstance(mask, float) else tree.math("MULTIPLY", f"Painted {label}", share, mask)


def add_face_variation(tree: Tree, surface: SurfaceSettings) -> tuple[Any, Any]:
    """Output sockets of a grey factor and of a change of roughness, drawn separately for each face of each rock.

    Their means are 1 - v/2 and 0, with v the setting ``face_variation``.
    """
    face = tree.attribute("Face", FACE_ATTRIBUTE)
    rock = tree.node("ShaderNodeObjectInfo", "Rock").outputs["Random"]
    place = tree.combined("Face of a Rock", face, 0.0)
    at = {"Vector": place, "W": rock}
    chance = tree.node("ShaderNodeTexWhiteNoise", "Chance of a Face", at, noise_dimensions="4D")
    parts = tree.node("ShaderNodeSeparateColor", "Chances", {"Color": find_output(chance, "Color")}, mode="RGB").outputs
    rough = (Number(tree, parts["Green"]) * 2.0 - 1.0) * surface.face_variation
    return _add_undimmed_share(tree, "Face", parts["Red"], surface.face_variation), rough.value


def find_darkest_factor(surface: SurfaceSettings) -> float:
    """The smallest factor on the albedo by ``add_brightness`` and by the faces of rocks."""
    dirt = ("trough_dirt", "slope_dirt") if surface.dirt == "BLACK" else ()
    return float(math.prod(1.0 - abs(surface[key]) for key in ("albedo_variation", "face_variation", *dirt)))


def find_threshold(share: float, deviation: float = NOISE_DEVIATION) -> float:
    """Find the value that this ``share`` of noise of four octaves and standard ``deviation`` exceeds."""
    return NOISE_MEAN + deviation * statistics.NormalDist().inv_cdf(min(max(1.0 - share, 1e-4), 1 - 1e-4))


def add_stained_share(tree: Tree, surface: SurfaceSettings, geometry: Node, fourth: float) -> Socket:
    """Output socket: 1 where salt covers the ground, 0 elsewhere. ``fourth`` selects the field."""
    share = surface.salt_share
    field = add_noise(tree, "Salt", geometry.outputs["Position"], surface.salt_patch_m, fourth, 4.0)
    deviation = _DEVIATION_OF_OWN_SALT if surface.salt == "OWN" else NOISE_DEVIATION
    threshold = find_threshold(share, deviation)
    return tree.ramp("Stained", field, threshold - _STAIN_EDGE, threshold + _STAIN_EDGE, smooth=True)
