"""Passes of light that was baked to ground and rocks: radiance by the light of each light group, and its error.

They are passes and no emission, since a ground that gives light lights itself: images would be 5 to 13 % too bright.
"""

from __future__ import annotations

from typing import Any

from ...support.labels import BAKED_AOVS, BAKED_ATTRIBUTES, BAKED_ERROR_AOVS, BAKED_ERROR_ATTRIBUTES
from ..tree.builder import Tree
from ..tree.formula import Number


def add_baked_passes(tree: Tree, reflectance: Any, rock: bool) -> None:
    """Add the passes ``BAKED_AOVS`` to a material of the ground, or of rocks, with this reflectance, and
    ``BAKED_ERROR_AOVS`` to one of the ground.

    Twelve numbers of a rock hold no noise from place to place, so rocks have no error.
    """
    level = (reflectance,) * 3 if isinstance(reflectance, float) else reflectance
    terms = _add_terms(tree) if rock else []
    for group, attribute in BAKED_ATTRIBUTES.items():
        light = _add_sum(tree, group, attribute, terms) if rock else _attribute(tree, group, "GEOMETRY", attribute)
        seen = tree.node(
            "ShaderNodeVectorMath",
            f"Reflected Baked Light of {group}",
            {"Vector": light, "Vector_001": level},
            operation="MULTIPLY",
        ).outputs[0]
        tree.node(
            "ShaderNodeOutputAOV", f"Baked Pass of {group}", {"Color": seen, "Value": 0.0}, aov_name=BAKED_AOVS[group]
        )
        if not rock:
            _add_error(tree, group, level)


def _add_error(tree: Tree, group: str, level: Any) -> None:
    error = _attribute(tree, f"{group}, Error", "GEOMETRY", BAKED_ERROR_ATTRIBUTES[group])
    seen = tree.node(
        "ShaderNodeVectorMath",
        f"Error of Baked Light of {group}",
        {"Vector": error, "Vector_001": level},
        operation="MULTIPLY",
    ).outputs[0]
    mean = tree.node(
        "ShaderNodeVectorMath",
        f"Mean Error of {group}",
        {"Vector": seen, "Vector_001": (1 / 3,) * 3},
        operation="DOT_PRODUCT",
    ).outputs["Value"]
    tree.node(
        "ShaderNodeOutputAOV",
        f"Error Pass of {group}",
        {"Color": (0.0,) * 4, "Value": mean},
        aov_name=BAKED_ERROR_AOVS[group],
    )


def _attribute(tree: Tree, group: str, kind: str, name: str) -> Any:
    return tree.node(
        "ShaderNodeAttribute", f"Baked Light of {group}", attribute_type=kind, attribute_name=name
    ).outputs["Vector"]


def _add_terms(tree: Tree) -> list[Any]:
    """The terms of ``physics.light.baked_rocks`` but for the first, which is 1."""
    normal = tree.node(
        "ShaderNodeSeparateXYZ",
        "Normal of Rock",
        {"Vector": tree.node("ShaderNodeNewGeometry", "Faces of Rock").outputs["Normal"]},
    )
    place = tree.node(
        "ShaderNodeSeparateXYZ",
        "Place on Rock",
        {"Vector": tree.node("ShaderNodeTexCoord", "Shape of Rock").outputs["Object"]},
    )
    x, y, z = (Number(tree, normal.outputs[axis]) for axis in "XYZ")
    of_normal = (x, y, z, x * y, y * z, z * x, x * x - y * y, 3.0 * (z * z) - 1.0)
    return [*(term.value for term in of_normal), *(place.outputs[axis] for axis in "XYZ")]


def _add_sum(tree: Tree, group: str, attribute: str, terms: list[Any]) -> Any:
    """The light of a rock: the sum of its numbers times terms, at least 0."""
    total = _attribute(tree, group, "INSTANCER", f"{attribute}_0")
    for k, term in enumerate(terms, start=1):
        part = tree.node(
            "ShaderNodeVectorMath",
            f"Part {k}",
            {"Vector": _attribute(tree, group, "INSTANCER", f"{attribute}_{k}"), "Scale": term},
            operation="SCALE",
        )
        total = tree.node(
            "ShaderNodeVectorMath", f"Sum {k}", {"Vector": total, "Vector_001": part.outputs[0]}, operation="ADD"
        ).outputs[0]
    return tree.node(
        "ShaderNodeVectorMath", "At Least None", {"Vector": total, "Vector_001": (0.0, 0.0, 0.0)}, operation="MAXIMUM"
    ).outputs[0]
