"""The user's own arm from a URDF file, as an ``Arm`` and its solids.

Its first link stands at the place of the parametric arm's shoulder, x forward, y left, z up. The first link, and joints
that do not move, have limits of 0.
"""

from __future__ import annotations

import math
import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import absolute_path, shorten
from ...support.foreign_bytes import describe_reason
from .kinematics import Arm, Capsule, Joint, make_rigid_transform
from .link_mesh import read_link_mesh
from .solids import Solid, join_solids, make_ball, make_box, make_lathe, transform_solid
from .urdf import FIXED, SLIDES, Shape, Urdf, UrdfJoint, read_urdf

#: Links above this size in metres are likely in another unit.
_WIDEST_LINK_M = 20.0
#: Maximum number of triangles of the whole arm.
MAX_TRIANGLES = 1_000_000
#: Pose that turns a solid of revolution about x into one about z.
_AXIS_X_TO_Z = make_rigid_transform(
    np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]) @ np.diag([-1.0, -1.0, 1.0])
)
_METAL = "metal"
#: Names of the built-in lander's parts; a user's link with such a name is renamed.
LANDER_PARTS = ("body", "mast", "leg_left", "leg_right", "head")


@dataclass(frozen=True)
class UrdfArm:
    """A user's arm. ``joints`` are all joints, as in ``kinematics.Arm``, and ``names`` the independent joints. Joint i
    has the value ``factors[i] * commanded[moving[i]] + offsets[i]``, where ``moving[i]`` is -1 for a joint without a
    commanded value. ``solids`` are the visible solids by link.
    """

    joints: tuple[Joint, ...]
    moving: Array
    factors: Array
    offsets: Array
    names: tuple[str, ...]
    solids: dict[str, Solid]
    capsules: tuple[Capsule, ...]

    def values(self, commanded: Array) -> Array:
        """Compute the values of all joints, in radians or metres, from the commanded values."""
        padded = np.append(commanded, 0.0)
        return np.asarray(self.factors * padded[self.moving] + self.offsets)

    def slides(self, name: str) -> bool:
        """Return whether the joint of this name slides, so that its value is in metres, not radians."""
        return next(joint.slides for joint in self.joints if joint.name == name)


def load_users_arm(settings: Settings) -> UrdfArm:
    """Load the arm of ``lander.file``. Raises IcyMoonError for a file that cannot be used."""
    path = absolute_path(settings.lander.file, "lander.file")
    return _load_arm(path, _file_state(path))


def list_arm_files(path: Path) -> list[Path]:
    """List a URDF file and the meshes that it names. Raises IcyMoonError for a file that cannot be used."""
    return [path, *_read_cached_urdf(path, _file_state(path)).files]


def make_arm_at(own: UrdfArm, base: Array) -> Arm:
    """Make the arm with its first link at ``base`` (4, 4); its tip is the origin of the last link."""
    return Arm(own.joints, base, np.zeros(3), own.capsules)


def parse_commanded(own: UrdfArm, text: str) -> Array:
    """Parse the values of the independent joints, in radians or metres, from the text of ``lander.joints``.

    The text has entries ``name=value`` in degrees or metres, or values in the order of the file. Joints without a value
    get 0. Names may have spaces. Raises IcyMoonError for other text.
    """
    found = dict.fromkeys(own.names, 0.0)
    any_name = "|".join(map(re.escape, sorted(own.names, key=len, reverse=True)))
    item = re.compile((rf"(?:({any_name})\s*=\s*)?" if own.names else "()") + r"([^\s,;]+(?:\s*=\s*[^\s,;]*)*)")
    for k, match in enumerate(item.finditer(text)):
        name = match[1] or (own.names[k] if k < len(own.names) else "")
        try:
            value = float(match[2])
        except ValueError:
            value = math.nan
            name = match[1] or ""
        if name not in found:
            raise IcyMoonError(
                f"lander.joints has {shorten(match[0])!r}, but the joints of the arm that move are "
                f"{shorten(', '.join(own.names)) or 'none'}; write name=value for each."
            )
        if not math.isfinite(value):
            raise IcyMoonError(
                f"lander.joints has {shorten(match[0])!r}; give a number, in degrees, or metres for a "
                "joint that slides."
            )
        found[name] = value if own.slides(name) else math.radians(value)
    return np.array([found[name] for name in own.names])


def _file_state(path: Path) -> tuple[int, int]:
    """Return the size and the modification time of a file, by which a cache detects a change. Raises IcyMoonError if
    the file cannot be read.
    """
    try:
        there = path.stat()
    except OSError as error:
        raise IcyMoonError(f"{path}: cannot be read ({describe_reason(error)}); check lander.file.") from None
    if not stat.S_ISREG(there.st_mode):  # a pipe or a device may never end
        raise IcyMoonError(f"{path}: is not a file; check lander.file.")
    return there.st_size, there.st_mtime_ns


@lru_cache(maxsize=8)
def _read_cached_urdf(path: Path, _state: tuple[int, int]) -> Urdf:
    return read_urdf(path)


def _load_arm(path: Path, state: tuple[int, int]) -> UrdfArm:
    urdf = _read_cached_urdf(path, state)
    return _build_arm(path, state, tuple((file, *_file_state(file)) for file in urdf.files))


@lru_cache(maxsize=4)
def _build_arm(path: Path, state: tuple[int, int], _files: tuple[tuple[Path, int, int], ...]) -> UrdfArm:
    """Build the arm of a URDF file. ``state`` and ``_files`` are cache keys that change with the files."""
    urdf = _read_cached_urdf(path, state)
    names = _rename_links(urdf)
    order = [urdf.root, *(joint.child for joint in urdf.joints)]

    def joint(each: UrdfJoint) -> Joint:
        parent, slides = order.index(each.parent), each.kind in SLIDES
        return Joint(each.name, names[each.child], parent, each.origin, each.axis, each.low, each.high, slides)

    still = Joint("", names[urdf.root], -1, make_rigid_transform(), np.array([0.0, 0.0, 1.0]), 0.0, 0.0)
    joints = (still, *map(joint, urdf.joints))
    free = [each.name for each in urdf.joints if each.kind not in FIXED and each.mimic is None]
    follows = [
        (None, 1.0, 0.0),
        *(
            (each.name if each.name in free else None, 1.0, 0.0) if each.mimic is None else each.mimic
            for each in urdf.joints
        ),
    ]
    solids: dict[str, Solid] = {}
    meshes: Meshes = {}
    left = MAX_TRIANGLES
    for link in order:
        if (solid := _make_link_solid(path, link, urdf.links[link], left, meshes)) is not None:
            solids[names[link]] = solid
            left -= len(solid.triangles)
    return UrdfArm(
        joints,
        np.array([free.index(name) if name else -1 for name, _, _ in follows]),
        np.array([factor for _, factor, _ in follows]),
        np.array([offset for *_, offset in follows]),
        tuple(free),
        solids,
        _fit_capsules(joints, solids),
    )


def _rename_links(urdf: Urdf) -> dict[str, str]:
    """Return the new name of each link: its name in the file, or ``arm_NAME`` if a part of the lander has that name."""
    found = {link: link for link in urdf.links}
    for link in LANDER_PARTS:
        if link in found:
            name = f"arm_{link}"
            while name in urdf.links:
                name = f"arm_{name}"
            found[link] = name
    return found


#: Vertices (n, 3) and triangles (m, 3) by mesh file; a robot may name one file many times.
Meshes = dict[Path, tuple[Array, Array]]


def _make_link_solid(path: Path, link: str, shapes: tuple[Shape, ...], most: int, meshes: Meshes) -> Solid | None:
    """Make the visible solid of a link; None if the link has no visible shape. Raises IcyMoonError for more than
    ``most`` triangles, and for a link so wide that its mesh must be in another unit.
    """
    if not shapes:
        return None
    made: list[Solid] = []
    for shape in shapes:
        made.append(_make_shape_solid(shape, meshes))
        most -= max(len(made[-1].triangles), len(made[-1].vertices) // 3)  # vertices without triangles take room too
        if most < 0:  # before the next one: a file may name one mesh many times
            raise IcyMoonError(
                f"{path}: its shapes have more than {MAX_TRIANGLES} triangles; make them coarser or fewer."
            )
    whole = join_solids(made)
    if (widest := float(np.abs(whole.vertices).max())) > _WIDEST_LINK_M:
        raise IcyMoonError(
            f"{path}: link {link} reaches {widest:.3g} m; its mesh is likely in millimetres: give it "
            'scale="0.001 0.001 0.001".'
        )
    return whole


def _make_shape_solid(shape: Shape, meshes: Meshes) -> Solid:
    if shape.file is not None:
        if shape.file not in meshes:
            meshes[shape.file] = read_link_mesh(shape.file)
        vertices, triangles = meshes[shape.file]
        if np.prod(shape.size) < 0:  # a mirrored mesh is inside out
            triangles = triangles[:, ::-1]
        made = Solid(vertices * shape.size, triangles, (_METAL,) * len(triangles), np.zeros(len(triangles), bool))
    elif shape.kind == "box":
        made = make_box(_METAL, shape.size, bevel_m=0.002)
    elif shape.kind == "sphere":
        made = make_ball(_METAL, (0.0, 0.0, 0.0), shape.size[0])
    else:
        radius, half = shape.size[0], shape.size[1] / 2
        made = transform_solid(
            make_lathe(_METAL, [(-half, 0.0), (-half, radius), (half, radius), (half, 0.0)]), _AXIS_X_TO_Z
        )
    return transform_solid(made, shape.origin)


def _fit_capsules(joints: tuple[Joint, ...], solids: Mapping[str, Solid]) -> tuple[Capsule, ...]:
    """Fit a capsule around each link: along its longest direction, as wide as the vertex farthest from that axis."""
    found = []
    for k, joint in enumerate(joints):
        if joint.link not in solids:
            continue
        places = solids[joint.link].vertices
        middle = (places.max(axis=0) + places.min(axis=0)) / 2
        along = np.linalg.svd(places[:: max(1, len(places) // 5000)] - middle, full_matrices=False)[2][0]
        at = (places - middle) @ along
        aside = np.linalg.norm(places - middle - at[:, None] * along, axis=1)
        radius = float(aside.max())
        # Shorten the capsule only as far as its round ends still contain each vertex.
        slack = np.sqrt(np.maximum(radius**2 - aside**2, 0.0))
        low, high = float((at + slack).min()), float((at - slack).max())
        if low > high:
            low = high = (low + high) / 2
        ends = [(float(x), float(y), float(z)) for x, y, z in (middle + low * along, middle + high * along)]
        found.append(Capsule(k, ends[0], ends[1], radius))
    return tuple(found)
