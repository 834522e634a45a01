"""Builds node trees, one call for each node.

A call must set every input of the node, because Blender's defaults differ between versions (Displacement Scale changed
from 1.0 to 0.01). An input that is missing is an error; None leaves it unconnected. Sockets are found by their
identifiers, which no version has renamed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, TypeAlias

import bpy

from ...support.arrays import Array

#: The output of a node (a number, a vector, a colour or a shader), and a node.
Socket: TypeAlias = bpy.types.NodeSocket
Node: TypeAlias = bpy.types.Node
#: A number, and a vector or colour: a constant, or the output socket that gives it.
Value: TypeAlias = float | Socket
Triple: TypeAlias = Sequence[float] | Socket

COLUMN, ROW = 220.0, 260.0
BLACK = (0.0, 0.0, 0.0, 1.0)
WHITE = (1.0, 1.0, 1.0, 1.0)
#: Inputs of a Principled surface with only its own colour and Fresnel's reflection, including inputs of some versions.
_PRINCIPLED_INPUTS = {
    "Metallic": 0.0,
    "IOR": 1.5,
    "Alpha": 1.0,
    "Normal": None,
    "Subsurface Weight": 0.0,
    "Subsurface Radius": (1.0, 1.0, 1.0),
    "Subsurface Scale": 0.0,
    "Specular IOR Level": 0.5,
    "Specular Tint": WHITE,
    "Anisotropic": 0.0,
    "Anisotropic Rotation": 0.0,
    "Tangent": None,
    "Transmission Weight": 0.0,
    "Coat Weight": 0.0,
    "Coat Roughness": 0.0,
    "Coat IOR": 1.5,
    "Coat Tint": WHITE,
    "Coat Normal": None,
    "Sheen Weight": 0.0,
    "Sheen Roughness": 0.5,
    "Sheen Tint": WHITE,
    "Emission Color": WHITE,
    "Emission Strength": 0.0,
}
_PRINCIPLED_IN_SOME = {
    "Weight": 0.0,
    "Diffuse Roughness": 0.0,
    "Subsurface Anisotropy": 0.0,
    "Thin Film Thickness": 0.0,
    "Thin Film IOR": 1.33,
    "Subsurface IOR": 1.4,
    "Thin Wall": False,
}
#: Operations on vectors that give a number.
_TO_NUMBER = ("DOT_PRODUCT", "LENGTH", "DISTANCE")


def list_non_socket_values(node: bpy.types.Node) -> list[Any]:
    """List the values of a node that are not in sockets: the name of its image, the points of its curves, its UV
    layer."""
    image, mapping = getattr(node, "image", None), getattr(node, "mapping", None)
    curves = getattr(mapping, "curves", ())
    points = [[tuple(point.location) for point in curve.points] for curve in curves]
    return [image.name if image else "", points, *([node.uv_map] if hasattr(node, "uv_map") else [])]


def find_output(node: bpy.types.Node, identifier: str) -> Socket:
    """Find the output socket with an identifier. No version has renamed identifiers, unlike names."""
    return next(socket for socket in node.outputs if socket.identifier == identifier)


class Tree:
    """A node tree under construction. Existing nodes are removed first, unless ``keep`` is true."""

    def __init__(self, node_tree: bpy.types.NodeTree, keep: bool = False) -> None:
        self.tree = node_tree
        if not keep:
            self.tree.nodes.clear()

    def node(
        self,
        kind: str,
        label: str,
        inputs: Mapping[str, Any] | None = None,
        *,
        if_present: Mapping[str, Any] | None = None,
        **properties: object,
    ) -> bpy.types.Node:
        """Add a node and return it. Raises ValueError if an input is missing or unknown.

        ``inputs`` maps identifiers of sockets to values, or to output sockets that are linked to them; None leaves a
        socket unconnected, such as a Normal input that then is the surface's own normal. ``if_present`` is the same for
        sockets that only some versions of Blender have. ``properties`` are set first, since the sockets depend on them.
        """
        node = self.tree.nodes.new(kind)
        node.name = node.label = label
        for name, value in properties.items():
            setattr(node, name, value)
        given = dict(inputs or {})
        present = {s.identifier: s for s in node.inputs if s.enabled}
        given |= {k: v for k, v in (if_present or {}).items() if k in present}
        missing = present.keys() - given.keys()
        given = {k: v for k, v in given.items() if v is not None}
        unknown = given.keys() - present.keys()
        if missing or unknown:
            raise ValueError(f"{kind} {label!r}: inputs not set {sorted(missing)}, unknown {sorted(unknown)}")
        for identifier, value in given.items():
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, present[identifier])
            else:
                present[identifier].default_value = value
        return node

    def math(self, operation: str, label: str, a: Value, b: Value | None = None, c: Value | None = None) -> Socket:
        """Add a Math node of one, two or three operands, and return its output socket."""
        operands = zip(("Value", "Value_001", "Value_002"), (a, b, c), strict=True)
        inputs = {key: value for key, value in operands if value is not None}
        return self.node("ShaderNodeMath", label, inputs, operation=operation, use_clamp=False).outputs[0]

    def vector(self, operation: str, label: str, a: Triple, b: Triple | None = None, c: Triple | None = None) -> Socket:
        """Add a Vector Math node of one, two or three vectors, and return its output socket."""
        operands = {"Vector": a, "Vector_001": b, "Vector_002": c}
        inputs = {key: value for key, value in operands.items() if value is not None}
        node = self.node("ShaderNodeVectorMath", label, inputs, operation=operation)
        return find_output(node, "Value" if operation in _TO_NUMBER else "Vector")

    def scaled(self, label: str, vector: Triple, factor: Value) -> Socket:
        """Add the product of a vector and a number, and return its output socket."""
        inputs = {"Vector": vector, "Scale": factor}
        return self.node("ShaderNodeVectorMath", label, inputs, operation="SCALE").outputs[0]

    def combined(self, label: str, x: Value, y: Value, z: Value = 0.0) -> Socket:
        """Combine three numbers to a vector, and return its output socket."""
        return self.node("ShaderNodeCombineXYZ", label, {"X": x, "Y": y, "Z": z}).outputs[0]

    def separated(self, label: str, vector: Triple) -> Sequence[Any]:
        """Separate a vector into its three numbers, and return their output sockets."""
        return self.node("ShaderNodeSeparateXYZ", label, {"Vector": vector}).outputs

    def colour(self, label: str, red: Value, green: Value, blue: Value) -> Socket:
        """Combine three bands to a colour, and return its output socket."""
        inputs = {"Red": red, "Green": green, "Blue": blue}
        return self.node("ShaderNodeCombineColor", label, inputs, mode="RGB").outputs[0]

    def mixed(self, label: str, share: Value, a: Triple, b: Triple) -> Socket:
        """Mix a ``share`` of the colour ``b`` with the rest of ``a``, and return the output socket."""
        return find_output(
            self.node(
                "ShaderNodeMix",
                label,
                {"Factor_Float": share, "A_Color": a, "B_Color": b},
                data_type="RGBA",
                blend_type="MIX",
                clamp_factor=True,
                clamp_result=False,
            ),
            "Result_Color",
        )

    def ramp(self, label: str, value: Value, zero: float, one: float, smooth: bool = False) -> Socket:
        """Add a ramp: 0 where ``value`` is ``zero``, 1 where it is ``one``, limited to that range. Return its output
        socket."""
        return self.node(
            "ShaderNodeMapRange",
            label,
            {"Value": value, "From Min": zero, "From Max": one, "To Min": 0.0, "To Max": 1.0},
            data_type="FLOAT",
            interpolation_type="SMOOTHSTEP" if smooth else "LINEAR",
            clamp=True,
        ).outputs[0]

    def noise(
        self,
        label: str,
        where: Mapping[str, Any],
        scale: Value,
        detail: Value,
        *,
        roughness: float = 0.5,
        normalize: bool = True,
    ) -> bpy.types.Node:
        """Add a noise node of ``detail`` + 1 octaves. ``where`` is its place: a Vector, a W, or both."""
        return self.node(
            "ShaderNodeTexNoise",
            label,
            {
                **where,
                "Scale": scale,
                "Detail": detail,
                "Roughness": roughness,
                "Lacunarity": 2.0,
                "Distortion": 0.0,
            },
            noise_dimensions=f"{3 * ('Vector' in where) + ('W' in where)}D",
            noise_type="FBM",
            normalize=normalize,
        )

    def attribute(self, label: str, name: str, identifier: str = "Fac", kind: str = "GEOMETRY") -> Socket:
        """Add an attribute of the mesh, or of the instance, and return its output socket."""
        return find_output(
            self.node("ShaderNodeAttribute", label, attribute_type=kind, attribute_name=name), identifier
        )

    def bump(self, label: str, height: Value, distance_m: float, normal: Socket | None = None) -> Socket:
        """Add bumps, ``distance_m`` high where ``height`` is 1, and return the output socket of the normal.

        The bumps are on the surface's own normal, or on ``normal``.
        """
        return self.node(
            "ShaderNodeBump",
            label,
            {"Strength": 1.0, "Distance": distance_m, "Height": height, "Normal": normal},
            if_present={"Filter Width": 0.1},
            invert=False,
        ).outputs[0]

    def diffuse(self, label: str, colour: Triple, normal: Socket | None = None) -> Socket:
        """Add Lambert's law with a normal, and return its shader socket. None means the mesh's own normal."""
        inputs = {"Color": colour, "Roughness": 0.0, "Normal": normal}
        return self.node("ShaderNodeBsdfDiffuse", label, inputs, if_present={"Weight": 0.0}).outputs[0]

    def principled(
        self, label: str, colour: Triple, roughness: Value, subsurface: str = "RANDOM_WALK", **others: object
    ) -> Socket:
        """Add a Principled surface, and return its shader socket. ``others`` are inputs that differ from
        ``_PRINCIPLED_INPUTS``."""
        return self.node(
            "ShaderNodeBsdfPrincipled",
            label,
            {"Base Color": colour, "Roughness": roughness} | _PRINCIPLED_INPUTS | others,
            if_present=_PRINCIPLED_IN_SOME,
            distribution="MULTI_GGX",
            subsurface_method=subsurface,
        ).outputs[0]

    def emission(self, label: str, colour: Triple, strength: Value) -> Socket:
        """Add a surface that emits light, and return its shader socket."""
        inputs = {"Color": colour, "Strength": strength}
        return self.node("ShaderNodeEmission", label, inputs, if_present={"Weight": 0.0}).outputs[0]

    def transparent(self, label: str, colour: Triple) -> Socket:
        """Add a surface that light passes straight through, and return its shader socket."""
        return self.node("ShaderNodeBsdfTransparent", label, {"Color": colour}, if_present={"Weight": 0.0}).outputs[0]

    def over(self, label: str, share: Value, under: Socket, layer: Socket) -> Socket:
        """Lay ``layer`` over its ``share`` of ``under``, and return the shader socket. At a share of 0 or 1, Cycles
        evaluates only one of the two."""
        inputs = {"Fac": share, "Shader": under, "Shader_001": layer}
        return self.node("ShaderNodeMixShader", label, inputs).outputs[0]

    def surface(self, shader: Socket, label: str = "Surface", target: str = "ALL", **others: object) -> None:
        """Connect a shader, and further sockets such as ``Volume``, to a material's output."""
        inputs = {"Surface": shader, "Displacement": None, "Volume": None, "Thickness": None} | others
        self.node("ShaderNodeOutputMaterial", label, inputs, target=target)

    def value_pass(self, label: str, name: str, colour: Triple = BLACK, value: Value = 0.0) -> None:
        """Write a colour and a value into a pass."""
        self.node("ShaderNodeOutputAOV", label, {"Color": colour, "Value": value}, aov_name=name)

    def curve(self, label: str, colour: Triple, x: Sequence[float] | Array, y: Sequence[float] | Array) -> Socket:
        """Add nodes that interpolate each band of a colour linearly between points (x, y), and return their output
        socket."""
        node = self.node("ShaderNodeRGBCurve", label, {"Fac": 1.0, "Color": colour})
        points = node.mapping.curves[3].points  # the curve of all bands, which has two points at first
        while len(points) < len(x):
            points.new(0.5, 0.5)
        for point, a, b in zip(points, x, y, strict=True):
            point.location, point.handle_type = (float(a), float(b)), "VECTOR"
        node.mapping.update()
        return node.outputs[0]

    def bands(
        self, label: str, place: Value, positions: Sequence[float], colours: Sequence[Sequence[float]]
    ) -> bpy.types.Node:
        """Add a node that interpolates colours (n, 3) linearly at ``place``, and return it. Their positions are n
        numbers from 0 to 1, with the first and the last at the ends."""
        node = self.node("ShaderNodeValToRGB", label, {"Fac": place})
        elements = node.color_ramp.elements  # two at first, at 0 and 1
        for position in positions[1:-1]:
            elements.new(position)
        for element, colour in zip(elements, colours, strict=True):
            element.color = (*colour, 1.0)
        node.color_ramp.interpolation = "LINEAR"
        return node

    def arrange(self) -> None:
        """Arrange the nodes in columns by their distance from the outputs, always in the same way."""
        depth = {node.name: 0 for node in self.tree.nodes}
        links = [(link.from_node.name, link.to_node.name) for link in self.tree.links]  # read once, since this is slow
        for _ in depth:
            before = dict(depth)
            for source, target in links:
                depth[source] = max(depth[source], depth[target] + 1)
            if depth == before:
                break
        rows: dict[int, int] = {}
        places: list[float] = []
        for node in self.tree.nodes:
            column = depth[node.name]
            row = rows[column] = rows.get(column, -1) + 1
            places += (-COLUMN * column, -ROW * row)
        self.tree.nodes.foreach_set("location", places)  # to move one node would update the whole tree


def _list_plain_properties(struct: bpy.types.bpy_struct) -> dict[str, Any]:
    """List the plain properties of a node, without properties of the node editor."""
    kind: Any = type(struct)
    return {name: getattr(struct, name) for name in _list_plain_names(kind)}


@lru_cache(maxsize=256)
def _list_plain_names(kind: Any) -> tuple[str, ...]:
    """List the names of the plain properties of a kind of node, which are slow to find."""
    return tuple(
        p.identifier
        for p in kind.bl_rna.properties
        if p.type in ("BOOLEAN", "INT", "FLOAT", "STRING", "ENUM")
        and not p.is_readonly
        and not getattr(p, "is_array", False)
        and p.identifier not in _EDITOR_PROPERTIES
    )


#: Properties of a node that affect only the node editor.
_EDITOR_PROPERTIES = {
    "select",
    "hide",
    "width",
    "height",
    "show_options",
    "show_preview",
    "show_texture",
    "use_custom_color",
    "is_active_output",
    "warning_propagation",
}


def copy_values(target: bpy.types.NodeTree, source: bpy.types.NodeTree) -> bool:
    """Copy the values of a tree to another with the same nodes and links; False, without a change, if they differ.

    A tree that keeps its nodes also keeps its compiled shader, so that the view can follow a slider.
    """

    def structure(tree: bpy.types.NodeTree) -> list[Any]:
        return [
            [(n.bl_idname, n.name, _list_plain_properties(n), list_non_socket_values(n)) for n in tree.nodes],
            [(k.from_node.name, k.from_socket.identifier, k.to_node.name, k.to_socket.identifier) for k in tree.links],
        ]

    if structure(target) != structure(source) or any(getattr(n, "node_tree", None) for n in source.nodes):
        return False
    for node in source.nodes:
        for old, new in zip(target.nodes[node.name].inputs, node.inputs, strict=True):
            # Blender updates the whole tree for each value that is set, even to itself.
            if hasattr(new, "default_value") and _is_other(old.default_value, new.default_value):
                old.default_value = new.default_value
    return True


def _is_other(value: Any, other: Any) -> bool:
    """Return whether two values of sockets differ: numbers, texts, data-blocks or arrays."""
    if isinstance(value, (str, bpy.types.ID)) or not hasattr(value, "__len__"):
        return bool(value != other)
    return tuple(value) != tuple(other)
