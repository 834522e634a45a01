"""Calls Embree without a wrapper: the library that Blender has for Cycles, or the library in the package embreex.

Embree 4 API, https://www.embree.org/api.html. Vertices stay where they are; Embree keeps a pointer to them.
"""

from __future__ import annotations

import ctypes
import importlib.util
from collections.abc import Iterator, Sequence
from ctypes import POINTER, c_char_p, c_float, c_int, c_size_t, c_uint, c_void_p
from pathlib import Path

import numpy as np

from ..support.arrays import Array
from .shapes import Hits, World

#: Names of the library on Linux, Windows and macOS.
_LIBRARY_NAMES = ("libembree4.so.4", "embree4.dll", "libembree4.4.dylib", "libembree4.dylib")
#: Patterns of the library's names in packages from PyPI, which add a suffix.
_WHEEL_PATTERNS = ("libembree4*.so*", "embree4*.dll", "libembree4*.dylib")
#: RTC_GEOMETRY_TYPE_TRIANGLE
_TRIANGLE_GEOMETRY = 0
#: RTC_GEOMETRY_TYPE_INSTANCE
_INSTANCE_GEOMETRY = 121
#: RTC_BUFFER_TYPE_INDEX
_INDEX_BUFFER = 0
#: RTC_BUFFER_TYPE_VERTEX
_VERTEX_BUFFER = 1
_UINT3, _FLOAT3, _FLOAT3X4_COLUMNS = 0x5003, 0x9003, 0x9234  # RTC_FORMAT_…
_ROBUST = 1 << 2  # RTC_SCENE_FLAG_ROBUST: no ray slips between two triangles that share an edge
_COHERENT = 1 << 16  # RTC_RAY_QUERY_FLAG_COHERENT
_ALL_FEATURES = 0xFFFFFFFF
_NO_GEOMETRY = 0xFFFFFFFF  # RTC_INVALID_GEOMETRY_ID
#: Number of rays in a packet.
RAYS_PER_PACKET = 16
#: Number of rows of a RTCRayHit16; the last row exists in newer versions only.
_PACKET_ROWS = 21
_ORIGIN, _NEAR, _DIRECTION, _FAR, _MASK, _U, _V, _TRIANGLE, _SHAPE, _PLACE = 0, 3, 4, 8, 9, 15, 16, 17, 18, 19
#: Least size of a direction's components. Embree divides by them, and packets with a smaller one may meet nothing.
_LEAST = 1e-12
#: Packets traced at a time: 44 MB.
_MAX_PACKETS = 2**15


Library = ctypes.CDLL


class _Arguments(ctypes.Structure):
    """RTCIntersectArguments and RTCOccludedArguments, which have the same fields."""

    _fields_ = [
        ("flags", c_uint),
        ("features", c_uint),
        ("context", c_void_p),
        ("filter", c_void_p),
        ("other", c_void_p),
        ("width", c_float),
    ]


_CALLS = {
    "rtcNewDevice": (c_void_p, [c_char_p]),
    "rtcReleaseDevice": (None, [c_void_p]),
    "rtcGetDeviceError": (c_int, [c_void_p]),
    "rtcNewScene": (c_void_p, [c_void_p]),
    "rtcReleaseScene": (None, [c_void_p]),
    "rtcSetSceneFlags": (None, [c_void_p, c_int]),
    "rtcCommitScene": (None, [c_void_p]),
    "rtcNewGeometry": (c_void_p, [c_void_p, c_int]),
    "rtcReleaseGeometry": (None, [c_void_p]),
    "rtcCommitGeometry": (None, [c_void_p]),
    "rtcAttachGeometry": (c_uint, [c_void_p, c_void_p]),
    "rtcSetSharedGeometryBuffer": (None, [c_void_p, c_int, c_uint, c_int, c_void_p, c_size_t, c_size_t, c_size_t]),
    "rtcSetGeometryInstancedScene": (None, [c_void_p, c_void_p]),
    "rtcSetGeometryTransform": (None, [c_void_p, c_uint, c_int, c_void_p]),
    "rtcIntersect16": (None, [c_void_p, c_void_p, c_void_p, POINTER(_Arguments)]),
    "rtcOccluded16": (None, [c_void_p, c_void_p, c_void_p, POINTER(_Arguments)]),
}


def _find_files(folders: Sequence[Path]) -> Iterator[str]:
    """Yield the candidate files of the library: in ``folders``, in embreex, and in the system's search path."""
    spec = importlib.util.find_spec("embreex")
    if spec is not None and spec.origin is not None:
        package = Path(spec.origin).parent
        folders = [*folders, package.with_name("embreex.libs"), package / ".dylibs", package]
    for folder in folders:
        for pattern in _WHEEL_PATTERNS:
            yield from map(str, sorted(folder.glob(pattern)))
    yield from _LIBRARY_NAMES


def load_library(folders: Sequence[Path] = ()) -> ctypes.CDLL | None:
    """Load Embree from one of ``folders``, else from the package embreex or the system; None if it is missing."""
    for file in _find_files(folders):
        try:
            library = ctypes.CDLL(file)
            for name, (result, arguments) in _CALLS.items():
                call = getattr(library, name)
                call.restype, call.argtypes = result, arguments
        except (OSError, AttributeError):  # the library is missing or has another version
            continue
        return library
    return None


class EmbreeTracer:
    """Traces rays through a world. Trees of shapes are built once; call ``place`` if only the matrices have changed."""

    name = "Embree"

    def __init__(self, library: ctypes.CDLL, world: World) -> None:
        """Build the search trees. Raises MemoryError if Embree has not enough memory for them."""
        self._library = library
        self._kept: list[Array] = []
        self._device = library.rtcNewDevice(None)
        self._top: int | None = None
        self._shape_scenes = [self._build_shape(each.shape.vertices, each.shape.triangles) for each in world.placed]
        self.place(world)

    def _build_shape(self, vertices: Array, triangles: Array) -> int:
        """Build an Embree scene of the triangles of a shape, and return its handle."""
        library = self._library
        # Embree reads four bytes after the last vertex.
        padded = np.empty((len(vertices) + 1, 3), np.float32)
        padded[:-1], padded[-1] = vertices, 0.0
        corners = np.ascontiguousarray(triangles, np.uint32)
        self._kept += [padded, corners]
        geometry = library.rtcNewGeometry(self._device, _TRIANGLE_GEOMETRY)
        for kind, form, values, count in (
            (_VERTEX_BUFFER, _FLOAT3, padded, len(vertices)),
            (_INDEX_BUFFER, _UINT3, corners, len(corners)),
        ):
            library.rtcSetSharedGeometryBuffer(geometry, kind, 0, form, values.ctypes.data, 0, 12, count)
        return self._commit([geometry])

    def _commit(self, geometries: Sequence[int]) -> int:
        """Make an Embree scene of these geometries, with its tree, and return its handle."""
        library = self._library
        scene = library.rtcNewScene(self._device)
        library.rtcSetSceneFlags(scene, _ROBUST)
        for geometry in geometries:
            library.rtcCommitGeometry(geometry)
            library.rtcAttachGeometry(scene, geometry)
            library.rtcReleaseGeometry(geometry)  # the scene keeps it
        library.rtcCommitScene(scene)
        if error := library.rtcGetDeviceError(self._device):
            raise MemoryError(f"Embree's error {error}")
        return scene

    def place(self, world: World) -> None:
        """Move the shapes to their places in another world with the same shapes."""
        library, geometries = self._library, []
        self._counts = np.concatenate([[0], np.cumsum([len(each.places) for each in world.placed])])
        for scene, each in zip(self._shape_scenes, world.placed, strict=True):
            columns = np.ascontiguousarray(each.places[:, :3].swapaxes(1, 2), np.float32)
            for matrix in columns:
                geometry = library.rtcNewGeometry(self._device, _INSTANCE_GEOMETRY)
                library.rtcSetGeometryInstancedScene(geometry, scene)
                library.rtcSetGeometryTransform(geometry, 0, _FLOAT3X4_COLUMNS, matrix.ctypes.data)
                geometries.append(geometry)
        before, self._top = self._top, self._commit(geometries)
        if before is not None:
            library.rtcReleaseScene(before)

    def close(self) -> None:
        """Free the memory of the search trees."""
        if self._top is not None:
            for scene in (self._top, *self._shape_scenes):
                self._library.rtcReleaseScene(scene)
            self._library.rtcReleaseDevice(self._device)
            self._top, self._kept = None, []

    def intersect(self, origin: Array, direction: Array, near: float, far: float) -> Hits:
        """Find the first hits of rays (n, 3) at ``near`` to ``far`` times their direction. ``origin`` is (3,) or
        (n, 3). Tracing is fastest if sixteen consecutive rays have similar directions. Distances are in single
        precision.
        """
        count = len(direction)
        along, place, triangle = np.empty(count), np.empty(count, np.int32), np.empty(count, np.int32)
        u, v = np.empty(count, np.float32), np.empty(count, np.float32)
        for part, packets in self._make_ray_packets(origin, direction, near, np.array(far, np.float32)):
            self._trace(self._library.rtcIntersect16, packets)
            own = packets.view(np.uint32)
            met = _flatten_packets(own[:, _SHAPE], part) != _NO_GEOMETRY
            place[part] = np.where(met, _flatten_packets(own[:, _PLACE], part), np.uint32(_NO_GEOMETRY)).view(np.int32)
            triangle[part] = _flatten_packets(own[:, _TRIANGLE], part).view(np.int32)
            along[part] = np.where(met, _flatten_packets(packets[:, _FAR], part), np.inf)
            u[part], v[part] = _flatten_packets(packets[:, _U], part), _flatten_packets(packets[:, _V], part)
        return Hits(along, place, triangle, u, v)

    def is_blocked(self, origin: Array, direction: Array, near: float, far: Array) -> Array:
        """Return whether (n,) rays (n, 3) meet anything from ``near`` to ``far`` (n,) times their direction; a ray that
        ends before it begins meets nothing."""
        blocked = np.empty(len(direction), bool)
        for part, packets in self._make_ray_packets(origin, direction, near, np.asarray(far, np.float32)):
            self._trace(self._library.rtcOccluded16, packets)
            blocked[part] = np.isneginf(_flatten_packets(packets[:, _FAR], part))
        return blocked

    def _make_ray_packets(
        self, origin: Array, direction: Array, near: float, far: Array
    ) -> Iterator[tuple[slice, Array]]:
        """Yield records (k, _PACKET_ROWS, RAYS_PER_PACKET) of rays, each with the slice of its rays."""
        count = len(direction)
        for first in range(0, count, _MAX_PACKETS * RAYS_PER_PACKET):
            part = slice(first, min(count, first + _MAX_PACKETS * RAYS_PER_PACKET))
            number = part.stop - part.start
            packets = _make_packets(-(-number // RAYS_PER_PACKET))
            for k in range(3):
                _fill_packets(packets[:, _ORIGIN + k], origin[k] if origin.ndim == 1 else origin[part, k])
                along = direction[part, k]
                _fill_packets(packets[:, _DIRECTION + k], np.where(np.abs(along) < _LEAST, _LEAST, along))
            _fill_packets(packets[:, _FAR], np.broadcast_to(far if far.ndim == 0 else far[part], number))
            packets[:, _NEAR] = near
            whole = packets.view(np.uint32)
            whole[:, _MASK], whole[:, _SHAPE:] = _NO_GEOMETRY, _NO_GEOMETRY
            yield part, packets

    def _trace(self, call: ctypes._NamedFuncPointer, packets: Array) -> None:
        """Let Embree trace the records in place."""
        arguments = ctypes.byref(_Arguments(_COHERENT, _ALL_FEATURES))
        valid = _make_packets(1)
        valid.view(np.int32)[:] = -1
        all_valid = valid.ctypes.data
        first, step = packets.ctypes.data, packets.strides[0]
        for number in range(len(packets)):
            call(all_valid, self._top, first + number * step, arguments)


def _make_packets(count: int) -> Array:
    """Allocate records (count, _PACKET_ROWS, RAYS_PER_PACKET), float32, all 0, at a multiple of 64 bytes."""
    memory = np.zeros(count * _PACKET_ROWS * RAYS_PER_PACKET + RAYS_PER_PACKET, np.float32)
    skip = -memory.ctypes.data % 64 // 4
    return memory[skip : skip + count * _PACKET_ROWS * RAYS_PER_PACKET].reshape(count, _PACKET_ROWS, RAYS_PER_PACKET)


def _fill_packets(target: Array, values: Array) -> None:
    """Write values of rays, one for all or (n,), into packets (k, RAYS_PER_PACKET); the last packet may have spare
    room."""
    if values.ndim == 0:
        target[:] = values
        return
    whole = len(values) // RAYS_PER_PACKET
    target[:whole] = values[: whole * RAYS_PER_PACKET].reshape(whole, RAYS_PER_PACKET)
    if rest := len(values) - whole * RAYS_PER_PACKET:
        target[whole, :rest], target[whole, rest:] = values[-rest:], values[-1]


def _flatten_packets(values: Array, part: slice) -> Array:
    """Flatten values (k, 16) of packets to one value for each ray of a part, (n,)."""
    return values.reshape(-1)[: part.stop - part.start]
