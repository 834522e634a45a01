"""Marks (hashes) of large arrays, such as the attributes of a mesh."""

from __future__ import annotations

import hashlib
from functools import lru_cache, partial
from typing import Any

import bpy
import numpy as np

from ...support.arrays import Array
from ...support.labels import BAKED_ATTRIBUTES
from ...support.steps import Steps, finish
from .mesh_arrays import LARGE_BYTES, get_memory, read_property

_BLOCK_SIZE, _HALF_WORD_BITS = 4096, np.uint64(32)
#: Way to read the attributes of each type: type of the array, name of the property, numbers for each element.
READERS_BY_TYPE: dict[str, tuple[Any, str, int]] = {
    "FLOAT": (np.float32, "value", 1),
    "INT": (np.int32, "value", 1),
    "BOOLEAN": (np.bool_, "value", 1),
    "FLOAT_VECTOR": (np.float32, "vector", 3),
    "FLOAT2": (np.float32, "vector", 2),
    "FLOAT_COLOR": (np.float32, "color", 4),
    "BYTE_COLOR": (np.float32, "color_srgb", 4),
    "INT8": (np.int8, "value", 1),
    "INT16_2D": (np.int16, "value", 2),
    "INT32_2D": (np.int32, "value", 2),
    "INT32_3D": (np.int32, "value", 3),
    "QUATERNION": (np.float32, "value", 4),
    "FLOAT4X4": (np.float32, "value", 16),
}
#: Prefix of the attributes by which errors are shown on the ground. They are removed before a render.
PAINTED = "icymoon_depth_error"
#: Attributes that are not marked: errors shown on the ground; baked light, which follows from the rest of the scene;
#: selection and hiding in Edit Mode; and the edges of corners, which follow from the vertices.
_LEFT_OUT = (
    PAINTED,
    *BAKED_ATTRIBUTES.values(),
    ".select",
    ".hide",
    ".uv_select",
    ".pin",
    ".vs.",
    ".es.",
    ".pn.",
    ".corner_edge",
)
_INDEX_ATTRIBUTES = (".corner_vert", ".edge_verts")


@lru_cache(maxsize=1)
def _draw_weights() -> Array:
    numbers = np.random.default_rng(1)  # a fixed seed, so that marks can be compared
    return numbers.integers(0, 2**64, (2, _BLOCK_SIZE), np.uint64) | np.uint64(1)


def mark_array(values: Array, indices: bool = False) -> str:
    """Hash an array's bytes. The hash need not withstand attacks, so it may take a third of the time of SHA-256.

    It hashes the sums of the array's words with random weights, block by block. In such a sum, changes of the highest
    bits of two words would cancel, so the upper halves of the words are summed too. ``indices`` never have that bit.
    """
    weights, raw = _draw_weights(), np.ascontiguousarray(values).reshape(-1).view(np.uint8)
    words = raw[: len(raw) // (8 * _BLOCK_SIZE) * 8 * _BLOCK_SIZE].view(np.uint64).reshape(-1, _BLOCK_SIZE)
    found = hashlib.sha256(np.array([np.dot(block, weights[0]) for block in words]).tobytes())
    if not indices:
        upper = np.empty(_BLOCK_SIZE, np.uint64)
        sums = [np.dot(np.right_shift(block, _HALF_WORD_BITS, out=upper), weights[1]) for block in words]
        found.update(np.array(sums).tobytes())
    found.update(raw[words.nbytes :].tobytes())
    return found.hexdigest()


def list_attribute_marks(geometry: bpy.types.ID) -> list[tuple[str, ...]]:
    """List the name, domain, type and mark of each attribute of a mesh, curves or points.

    Attributes that are false or 0 everywhere are left out, since Blender adds and removes them by itself.
    """
    return finish(_list_attribute_marks(geometry))


def _list_attribute_marks(geometry: bpy.types.ID) -> Steps[list[tuple[str, ...]]]:
    """Do the same as ``list_attribute_marks``, one attribute in each step; any thread may prepare and hash the large
    arrays."""
    found = []
    for name in geometry.attributes.keys():  # noqa: SIM118 - the attributes may move in memory during a pause
        attribute = geometry.attributes.get(name)
        if attribute is None or name.startswith(_LEFT_OUT) or not len(attribute.data):
            continue
        kind, domain = attribute.data_type, attribute.domain
        if kind in READERS_BY_TYPE:
            values = yield from _read_in_steps(geometry, name)
            if (kind == "BOOLEAN" or name == "material_index") and not values.any():
                continue
            marked = yield from _mark_in_steps(values, name in _INDEX_ATTRIBUTES)
        else:
            marked = repr([getattr(item, "value", None) for item in attribute.data])
        found.append((name, domain, kind, marked))
        yield None
    return sorted(found)


def _read_in_steps(geometry: bpy.types.ID, name: str) -> Steps[Array]:
    """Read the values of an attribute of a known type; empty if it was removed meanwhile."""
    attribute = geometry.attributes[name]
    kind = attribute.data_type
    dtype, key, width = READERS_BY_TYPE[kind]
    memory = yield from get_memory(len(attribute.data) * width, dtype)
    attribute = geometry.attributes.get(name)
    if attribute is None or attribute.data_type != kind:
        return memory[:0]
    return read_property(attribute.data, key, dtype, width, memory)


def _mark_in_steps(values: Array, indices: bool = False) -> Steps[str]:
    """Hash an array as ``mark_array`` does, in steps; any thread may hash a large array."""
    if values.nbytes <= LARGE_BYTES:
        return mark_array(values, indices)
    found: str = yield partial(mark_array, values, indices)
    return found


def list_mesh_marks(mesh: bpy.types.Mesh) -> list[Any]:
    """List the marks of all arrays of a mesh at once, see ``list_mesh_marks_in_steps``."""
    return finish(list_mesh_marks_in_steps(mesh))


def list_mesh_marks_in_steps(mesh: bpy.types.Mesh) -> Steps[list[Any]]:
    """List the marks of all arrays of a mesh, in steps. A mesh in Edit Mode has no arrays: pass a copy."""
    attributes = yield from _list_attribute_marks(mesh)
    normals = []
    if mesh.has_custom_normals and "custom_normal" not in mesh.attributes:  # before 4.5
        normals = [(yield from _mark_in_steps(read_property(mesh.corner_normals, "vector", width=3)))]
    shown_uv = next((layer.name for layer in mesh.uv_layers if layer.active_render), "")
    sizes = [len(mesh.vertices), len(mesh.edges), len(mesh.loops), len(mesh.polygons)]
    colour = mesh.attributes.default_color_name or ""
    # 5.2 keeps the name of a removed attribute.
    if colour.startswith((PAINTED, *BAKED_ATTRIBUTES.values())) or colour not in mesh.attributes:
        colour = ""
    return [sizes, attributes, normals, shown_uv, colour]
