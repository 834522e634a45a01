"""The material of the planet that the camera sees: the radiance at each pixel by the model of ``planet_face``.

A radiance at the vertices only would give the terminator and the shadow of the rings one tooth per sector of the mesh.
"""

from __future__ import annotations

import math

import bpy
import numpy as np

from ...physics.light.planet_face import (
    FACES,
    MIN_COSINE,
    SPOT_EDGES,
    SPOT_SOFTNESS,
    Face,
    Spot,
    face_scale,
    spot_axes,
)
from ...physics.light.planetshine import Planet, make_ellipsoid
from ...support.arrays import Array
from ...support.blender import compat
from ..tree.builder import WHITE, Socket, Tree, Triple, Value, find_output
from ..tree.followed_tree import FollowedTree, OtherTreeError

#: Longest wavelength of the ripples of bands along a circle of latitude, in radii, and the ratio of the wavelengths
#: along and across the bands.
_RIPPLE_LENGTH, _RIPPLE_STRETCH = 0.2, 8.0


def build_planet_material(
    name: str, planet: Planet, colour: Array, distance_m: float, transmission: str
) -> bpy.types.Material:
    """Build the material of a mesh about the observer that shows the planet ``distance_m`` metres away. ``colour`` (3,)
    is the Sun's colour.

    ``transmission`` names the attribute of the mesh that has the share of the light from behind that passes.
    """
    material = bpy.data.materials.new(name)
    _fill_tree(Tree(compat.ensure_nodes(material)), planet, colour, distance_m, transmission)
    return material


def follow_planet(
    material: bpy.types.Material, planet: Planet, colour: Array, distance_m: float, transmission: str
) -> bool:
    """Give the material of a planet the values for another Sun; False if it needs other nodes."""
    try:
        _fill_tree(FollowedTree(material.node_tree), planet, colour, distance_m, transmission)
    except OtherTreeError:
        return False
    return True


def _fill_tree(tree: Tree, planet: Planet, colour: Array, distance_m: float, transmission: str) -> None:
    globe = _Globe(tree, planet, distance_m)
    face = FACES.get(planet.face)
    if face is None:
        shade: Value = tree.math("MULTIPLY", "Sunlit", globe.incidence, globe.add_passed())
        light: Triple = (*map(float, colour), 1.0)
    else:
        shade = globe.add_passed()
        light = _add_face(globe, face, np.array(face_scale(planet)) * colour)
    strength = tree.math("MULTIPLY", "Radiance", shade, make_ellipsoid(planet).full_radiance)
    passed = tree.attribute("Transmission", transmission)
    behind = tree.transparent("Behind", WHITE)
    tree.surface(tree.over("Limb", passed, tree.emission("Shine", light, strength), behind))
    tree.arrange()


class _Globe:
    """Sockets of the shaded point of the planet, such as its normal and the cosine of incidence.

    The unit of length is the radius of the equator.
    """

    def __init__(self, tree: Tree, planet: Planet, distance_m: float) -> None:
        self.tree, self.planet = tree, planet
        shape = make_ellipsoid(planet)
        place = find_output(tree.node("ShaderNodeTexCoord", "From the Camera", from_instancer=False), "Object")
        self.toward = tree.vector("NORMALIZE", "Toward the Camera", tree.scaled("Back", place, -1.0))
        centred = tree.vector(
            "SUBTRACT", "From the Centre", tree.scaled("Distances", place, 1 / distance_m), tuple(planet.direction)
        )
        radii = tree.scaled("Radii", centred, 1 / shape.radius)
        # The mesh is flat between its vertices, the globe is not.
        self.sphere = tree.vector("NORMALIZE", "Sphere", self.stretch_along_pole("Stretched", radii, self._stretch))
        self.normal = tree.vector("NORMALIZE", "Normal", self.stretch_along_pole("Upright", self.sphere, self._stretch))
        self.incidence = tree.math(
            "MAXIMUM", "Cosine of Incidence", self.dot("To the Sun", self.normal, planet.sun), 0.0
        )

    @property
    def _stretch(self) -> float:
        return 1 / (1 - self.planet.flattening) - 1

    def dot(self, label: str, a: Socket, b: Socket | Array) -> Socket:
        """Add the dot product of a socket with another socket or a vector, and return its socket."""
        b = b if isinstance(b, bpy.types.NodeSocket) else tuple(map(float, b))
        return self.tree.vector("DOT_PRODUCT", label, a, b)

    def stretch_along_pole(self, label: str, a: Socket, more: float) -> Socket:
        """Make the part of a vector along the pole longer by a factor 1 + ``more``, and return the vector's socket."""
        up = self.tree.scaled(
            f"{label} Pole",
            tuple(map(float, self.planet.pole)),
            self.dot(f"{label} Height", a, self.planet.pole * more),
        )
        return self.tree.vector("ADD", label, a, up)

    def add_passed(self) -> Value:
        """Add the share of the sunlight that the rings let through: a socket, or 1 without a shadow of the rings."""
        rise = float(self.planet.sun @ self.planet.pole)
        if not self.planet.rings or abs(rise) < 1e-6:
            return 1.0
        tree, place = self.tree, self.stretch_along_pole("On the Globe", self.sphere, -self.planet.flattening)
        way = self.dot("Way to the Ring Plane", place, -self.planet.pole / rise)
        sunward = tree.scaled("Sunward", tuple(map(float, self.planet.sun)), way)
        radius = tree.vector("LENGTH", "Radius of the Crossing", tree.vector("ADD", "Crossing", place, sunward))
        ahead = tree.math("GREATER_THAN", "Toward the Sun", way, 0.0)
        passed: Value = 1.0
        for number, ring in enumerate(self.planet.rings):
            # Not a colour ramp: its table of 256 entries would move the edges.
            beyond = tree.math("GREATER_THAN", f"Beyond the Inner Edge {number}", radius, ring.inner)
            within = tree.math("LESS_THAN", f"Within the Outer Edge {number}", radius, ring.outer)
            crossed = tree.math(
                "MULTIPLY", f"Crossed {number}", ahead, tree.math("MULTIPLY", f"In Ring {number}", beyond, within)
            )
            lost = tree.math("MULTIPLY", f"Lost {number}", crossed, 1 - math.exp(-ring.optical_depth / abs(rise)))
            passed = tree.math(
                "MULTIPLY", f"Passed {number}", passed, tree.math("SUBTRACT", f"Left {number}", 1.0, lost)
            )
        return passed


def _add_face(globe: _Globe, face: Face, factors: Array) -> Socket:
    """Add the colour of a place, and return its socket: the pattern of the face times its limb darkening times
    ``factors`` for R, G and B."""
    tree, exponents = globe.tree, face.limb.exponents_at(globe.planet.phase_deg)
    emission = tree.math(
        "MAXIMUM", "Cosine of Emission", globe.dot("To the Camera", globe.normal, globe.toward), MIN_COSINE
    )
    both = tree.math("MULTIPLY", "Both Cosines", globe.incidence, emission)
    if face.limb.law == "BARKSTROM":
        both = tree.math("DIVIDE", "Over their Sum", both, tree.math("ADD", "Sum", globe.incidence, emission))
    limb = tree.combined(
        "Limb Darkening",
        *(
            tree.math("DIVIDE", f"Limb {band}", tree.math("POWER", f"Power {band}", both, exponent), emission)
            for band, exponent in zip("RGB", exponents, strict=True)
        ),
    )
    pattern = _add_bands(globe, face)
    if face.spot is not None:
        pattern = _add_spot(globe, face.spot, pattern)
    return tree.vector(
        "MULTIPLY", "Colour", tree.vector("MULTIPLY", "Shaded Pattern", pattern, limb), tuple(factors.tolist())
    )


def _add_bands(globe: _Globe, face: Face) -> Socket:
    """Add the reflectance at each latitude, and return its socket."""
    tree = globe.tree
    sine = globe.dot("Sine of Latitude", globe.normal, globe.planet.pole)
    if face.ripple_deg > 0:
        stretched = globe.stretch_along_pole("Ripple Place", globe.sphere, _RIPPLE_STRETCH - 1)
        noise = tree.noise("Ripples", {"Vector": stretched}, 1 / _RIPPLE_LENGTH, 2.0).outputs[0]
        # Blender's noise is around 0.5, with a standard deviation of about 0.1.
        wave = tree.math(
            "MULTIPLY", "Ripple", tree.math("SUBTRACT", "Around 0", noise, 0.5), math.radians(face.ripple_deg) / 0.1
        )
        sine = tree.math("ADD", "Rippled Latitude", sine, wave)
    place = tree.math("MULTIPLY_ADD", "Pole to Pole", sine, 0.5, 0.5)
    return find_output(
        tree.bands("Bands", place, [(height + 1) / 2 for height in face.sine], face.reflectance), "Color"
    )


def _add_spot(globe: _Globe, spot: Spot, pattern: Socket) -> Socket:
    """Add an oval spot with its collar to a pattern, and return the new pattern."""
    tree, (middle, east, north) = globe.tree, spot_axes(globe.planet, spot)
    place = tree.combined(
        "Place in the Spot",
        globe.dot("East of the Spot", globe.normal, east / spot.half_length),
        globe.dot("North of the Spot", globe.normal, north / spot.half_height),
    )
    away = tree.vector("LENGTH", "Radii from the Spot", place)
    here = tree.math("GREATER_THAN", "On its Side", globe.dot("Toward the Spot", globe.normal, middle), 0.0)
    for label, edge, colour in zip(("Collar", "Spot"), SPOT_EDGES[::-1], (spot.collar, spot.reflectance), strict=True):
        inside = tree.ramp(f"In the {label}", away, edge + SPOT_SOFTNESS / 2, edge - SPOT_SOFTNESS / 2)
        covered = tree.math("MULTIPLY", f"{label} Here", inside, here)
        pattern = tree.mixed(label, covered, pattern, (*colour, 1.0))
    return pattern
