"""Value passes of the light that was baked to ground and rocks: the radiance by each light group, and its error.

Baked light is a pass and not emission, because emitting ground would light itself: images would be 5 to 13 % too
bright.
"""

from __future__ import annotations

from typing import Any

from ...support.labels import BAKED_AOVS, BAKED_ATTRIBUTES, BAKED_ERROR_AOVS, BAKED_ERROR_ATTRIBUTES
from ..tree.builder import Socket, Tree, Triple, Value
from ..tree.formula import Number


def add_baked_passes(tree: Tree, reflectance: Value, rock: bool) -> None:
    """Add the passes ``BAKED_AOVS`` to a material of the ground or of rocks with this ``reflectance``. A material of
    the ground also gets ``BAKED_ERROR_AOVS``.

    The light of a rock is twelve numbers, which have no noise from place to place, so rocks have no error pass.
    """
    level = (reflectance,) * 3 if isinstance(reflectance, float) else reflectance
    terms = _add_terms(tree) if rock else []
    for group, attribute in BAKED_ATTRIBUTES.items():
        light = _add_sum(tree, group, attribute, terms) if rock else _attribute(tree, group, "GEOMETRY", attribute)
        seen = tree.vector("MULTIPLY", f"Reflected Baked Light of {group}", light, level)
        tree.value_pass(f"Baked Pass of {group}", BAKED_AOVS[group], seen)
        if not rock:
            _add_error(tree, group, level)


def _add_error(tree: Tree, group: str, level: Triple) -> None:
    error = _attribute(tree, f"{group}, Error", "GEOMETRY", BAKED_ERROR_ATTRIBUTES[group])
    seen = tree.vector("MULTIPLY", f"Error of Baked Light of {group}", error, level)
    mean = tree.vector("DOT_PRODUCT", f"Mean Error of {group}", seen, (1 / 3,) * 3)
    tree.value_pass(f"Error Pass of {group}", BAKED_ERROR_AOVS[group], (0.0,) * 4, mean)


def _attribute(tree: Tree, group: str, kind: str, name: str) -> Socket:
    return tree.attribute(f"Baked Light of {group}", name, "Vector", kind)


def _add_terms(tree: Tree) -> list[Any]:
    """Add the terms of ``physics.light.baked_rocks`` without the first, which is 1, and return their sockets or
    values."""
    faces = tree.node("ShaderNodeNewGeometry", "Faces of Rock").outputs["Normal"]
    normal = tree.separated("Normal of Rock", faces)
    place = tree.separated("Place on Rock", tree.node("ShaderNodeTexCoord", "Shape of Rock").outputs["Object"])
    x, y, z = (Number(tree, part) for part in normal)
    of_normal = (x, y, z, x * y, y * z, z * x, x * x - y * y, 3.0 * (z * z) - 1.0)
    return [*(term.value for term in of_normal), *place]


def _add_sum(tree: Tree, group: str, attribute: str, terms: list[Any]) -> Socket:
    """Add the light of a rock: the sum of its baked coefficients times the terms, at least 0."""
    total = _attribute(tree, group, "INSTANCER", f"{attribute}_0")
    for k, term in enumerate(terms, start=1):
        part = tree.scaled(f"Part {k}", _attribute(tree, group, "INSTANCER", f"{attribute}_{k}"), term)
        total = tree.vector("ADD", f"Sum {k}", total, part)
    return tree.vector("MAXIMUM", "At Least None", total, (0.0, 0.0, 0.0))
