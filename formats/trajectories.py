"""Trajectories: poses of a camera in text files, as TUM, KITTI and CSV have them.

* TUM: ``t x y z qx qy qz qw`` a line, comments after #.
* KITTI: the twelve numbers of a 3x4 matrix a line, row by row, from the camera's axes to the world's; stamps are in a
  file of their own (``times.txt``), a line each.
* CSV: a first line of names, among them t (or timestamp, with [ns] or t_ns in nanoseconds), x, y, z, qx, qy, qz, qw,
  as such or as EuRoC writes them (``p_RS_R_x [m]``).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from ..physics.camera.pose_sequence import PoseSequence
from ..physics.camera.rotations import from_quaternion, nearest_rotation, quaternion, rotation_error
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.files import quote, shorten
from ..support.foreign_bytes import MAX_TEXT_BYTES, ForeignBytes, read
from ..support.number_text import format_count

TRAJECTORY_KINDS = ("TUM", "KITTI", "CSV")
_POSE_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")
#: Names of the column of stamps, in lower case, and their unit in seconds.
_STAMP_COLUMNS = {
    **dict.fromkeys(("t", "t_s", "time", "stamp", "timestamp"), "1"),
    **dict.fromkeys(("t_ns", "timestamp_ns", "timestamp [ns]"), "1e-9"),
}
#: Prefixes of EuRoC's names of columns, and their replacements.
_EUROC_NAME_ENDS = {"p_rs_r_": "", "q_rs_": "q"}
#: Deviation of a quaternion's length from 1, or of a matrix from a rotation, up to which it counts as rounding to six
#: digits.
_MAX_ROUNDING = 1e-5
#: Largest deviation that is accepted, with a note.
_LARGEST_DEVIATION = 0.1
#: Maximum number of poses of a file.
MAX_POSES = 1_000_000
#: Stamps in seconds are below this: at most twelve digits before the point.
_LARGEST_STAMP_S = Decimal(10**12)
#: Smallest step of a stamp: nine digits after the point.
_NANOSECOND = Decimal("1e-9")
_FIX = "give lines of t x y z qx qy qz qw (TUM), 3x4 matrices (KITTI), or a CSV file with a line of names"


@dataclass(frozen=True)
class Trajectory:
    """The poses of a file in its own world axes. ``kind`` is one of ``TRAJECTORY_KINDS``. The other fields tell whether
    the file has stamps, and which changes were made, as sentences."""

    poses: PoseSequence
    kind: str
    stamped: bool
    notes: tuple[str, ...] = ()


def read_trajectory(path: Path, kind: str = "", times: Path | None = None, camera: Array | None = None) -> Trajectory:
    """Read the poses of a file, in its own world axes and in metres.

    ``kind`` is one of ``TRAJECTORY_KINDS``; without it the suffix .csv and the count of numbers in the first line
    decide. ``times`` is a file of stamps, one a line, in place of the file's own. ``camera`` (3, 3) has the camera's
    axes x right, y down, z forward as columns, in the axes that the file's rotations use; by default the file's
    rotations use the camera's own axes. Poses without stamps are a second apart. Raises IcyMoonError, one sentence with
    the line, for a file without a trajectory.
    """
    axes = np.eye(3) if camera is None else camera

    def parse(foreign: ForeignBytes) -> Trajectory:
        rows = _list_data_lines(foreign, names="CSV" in (kind, path.suffix[1:].upper()))
        first = next(rows, None)
        if first is None:
            raise ValueError("it has no poses")
        return _Poses(kind or _detect_format(path, first[1]), axes).parse(first, rows)

    found = read(path, parse, f"a trajectory{f' of {kind}' if kind else ''}", _FIX, MAX_TEXT_BYTES)
    if times is None:
        return found
    stamps = read(times, _parse_times, "a list of stamps", "give one number a line, in seconds", MAX_TEXT_BYTES)
    if len(stamps) != len(found.poses):
        raise IcyMoonError(
            f"{times}: has {len(stamps)} stamps, and {path} has {len(found.poses)} poses; give a stamp for each."
        )
    return replace(found, poses=replace(found.poses, stamp=stamps), stamped=True)


def format_pose(pose: Array) -> str:
    """Write a pose (4, 4) as the text ``x y z qx qy qz qw``, with all digits."""
    w, x, y, z = quaternion(pose[:3, :3])
    return " ".join(repr(float(value)) for value in (*pose[:3, 3], x, y, z, w))


def tum_text(stamps: Sequence[Decimal], poses: Sequence[Array], about: str) -> str:
    """Write poses (4, 4) by stamps in seconds as a file in TUM's format. Its first line is the comment ``about``."""
    lines = [f"{stamp:.9f} {format_pose(pose)}\n" for stamp, pose in zip(stamps, poses, strict=True)]
    return "".join([f"# {about}\n# timestamp tx ty tz qx qy qz qw\n", *lines])


def _list_data_lines(foreign: ForeignBytes, names: bool = False) -> Iterator[tuple[int, str]]:
    """List the number and the text of each line that is neither empty nor a comment (#). With ``names`` the first line
    is always returned, because EuRoC's names begin with #."""
    for number, line in foreign.lines():
        text = line.decode("utf-8-sig" if number == 1 else "utf-8").strip()
        if text and (names or not text.startswith("#")):
            names = False
            yield number, text


def _detect_format(path: Path, first: str) -> str:
    if path.suffix.lower() == ".csv":
        return "CSV"
    count = len(first.split())
    if count not in (8, 12):
        if "," in first:
            raise ValueError("its first line has commas; state its format as CSV, or end its name in .csv")
        raise ValueError(f"its first line has {format_count(count, 'word')}, and TUM has 8, KITTI 12")
    return "TUM" if count == 8 else "KITTI"


def _parse_times(foreign: ForeignBytes) -> tuple[Decimal, ...]:
    return tuple(_parse_stamp_s(text, Decimal(1), number) for number, text in _list_data_lines(foreign))


def _parse_stamp_s(text: str, unit_s: Decimal, line: int) -> Decimal:
    """Parse a stamp in seconds, rounded to nanoseconds."""
    try:
        seconds = Decimal(text) * unit_s
        if seconds.is_finite() and abs(seconds) < _LARGEST_STAMP_S:
            return seconds.quantize(_NANOSECOND)
    except InvalidOperation:
        pass
    raise ValueError(f"line {line} has the stamp {quote(shorten(text))}, which is not a number of seconds")


class _Poses:
    """Parses the poses of a file."""

    def __init__(self, kind: str, axes: Array) -> None:
        self._kind, self._axes = kind, axes
        self._columns: Mapping[str, int] = {}
        self._unit_s = Decimal(1)
        self._off, self._line_off, self._not_unit = 0.0, 0, 0

    def parse(self, first: tuple[int, str], rest: Iterator[tuple[int, str]]) -> Trajectory:
        """Parse the poses of the first line and of the rest."""
        rows: list[tuple[int, str]] = []
        if self._kind == "CSV":
            self._read_names(first[1])
        else:
            rows.append(first)
        positions, rotations, stamps = [], [], []
        lines: list[int] = []
        for number, text in (*rows, *rest):
            if len(lines) == MAX_POSES:
                raise ValueError(f"it has more than {MAX_POSES} poses, so cut it into several files")
            stamp, position, rotation = self._read_pose(number, text, len(lines))
            positions.append(position)
            rotations.append(rotation @ self._axes)
            stamps.append(stamp)
            lines.append(number)
        if not lines:
            raise ValueError("it has no poses")
        poses = PoseSequence(np.array(positions), np.array(rotations), tuple(stamps), tuple(lines))
        return Trajectory(poses, self._kind, self._kind != "KITTI", self._notes())

    def _notes(self) -> tuple[str, ...]:
        if not self._not_unit:
            return ()
        count = self._not_unit
        what = format_count(count, "matrix", "matrices") if self._kind == "KITTI" else format_count(count, "quaternion")
        return (f"{what} normalised (line {self._line_off} is off by {self._off:.2g})",)

    def _read_names(self, text: str) -> None:
        """Find the columns from the first line of a CSV file."""
        names: dict[str, int] = {}
        for k, name in enumerate(map(_short_name, _cells(text))):
            if name in names and name in (*_STAMP_COLUMNS, *_POSE_COLUMNS):
                raise ValueError(f"its first line names {name} twice")
            names[name] = k
        stamps = [name for name in _STAMP_COLUMNS if name in names]
        if len(stamps) > 1:
            raise ValueError(f"its first line names the stamps {' and '.join(stamps)}, so leave one out")
        stamp = next(iter(stamps), None)
        missing = [*([] if stamp else ["t"]), *(name for name in _POSE_COLUMNS if name not in names)]
        if missing or stamp is None:
            raise ValueError(f"its first line names no column {', '.join(missing)}")
        self._columns = {"t": names[stamp], **{name: names[name] for name in _POSE_COLUMNS}}
        self._unit_s = Decimal(_STAMP_COLUMNS[stamp])

    def _read_pose(self, line: int, text: str, count: int) -> tuple[Decimal, Array, Array]:
        """Read the stamp, the position and the rotation of a line, which follows ``count`` other poses."""
        words = _cells(text) if self._kind == "CSV" else text.split()
        if self._kind == "KITTI":
            matrix = np.array(_numbers(words, 12, line)).reshape(3, 4)
            return Decimal(count), matrix[:, 3], self._rotation(matrix[:, :3], line)
        if self._kind == "CSV":
            if len(words) <= max(self._columns.values()):
                raise ValueError(f"line {line} has {len(words)} columns, fewer than the line of names")
            words = [words[k] for k in self._columns.values()]
        numbers = np.array(_numbers(words, 8, line))
        return _parse_stamp_s(words[0], self._unit_s, line), numbers[1:4], self._turn(numbers[4:], line)

    def _turn(self, xyzw: Array, line: int) -> Array:
        length = float(np.linalg.norm(xyzw))
        self._note(abs(length - 1), line, f"a quaternion of length {length:.3g}")
        return from_quaternion(xyzw[[3, 0, 1, 2]])

    def _rotation(self, matrix: Array, line: int) -> Array:
        off = rotation_error(matrix)
        why = f"off by {off:.3g}" if math.isfinite(off) else "mirrored or flat"
        self._note(off, line, f"a matrix that is not a rotation, {why}")
        return from_quaternion(quaternion(nearest_rotation(matrix)))

    def _note(self, off: float, line: int, what: str) -> None:
        """Remember a deviation larger than rounding. Raises ValueError if it is too large."""
        if not off <= _LARGEST_DEVIATION:
            raise ValueError(f"line {line} has {what}")
        if off > _MAX_ROUNDING:
            self._not_unit += 1
        if off > max(self._off, _MAX_ROUNDING):
            self._off, self._line_off = off, line


def _numbers(words: list[str], count: int, line: int) -> list[float]:
    if len(words) != count:
        raise ValueError(f"line {line} has {len(words)} words, not {count}")
    try:
        found = [float(word) for word in words]
    except ValueError:
        raise ValueError(f"line {line} has a word that is not a number") from None
    if not all(map(math.isfinite, found)):
        raise ValueError(f"line {line} has a number that is not finite")
    return found


def _cells(text: str) -> list[str]:
    return [cell.strip().strip('"') for cell in text.split(",")]


def _short_name(name: str) -> str:
    """Return a column's name in lower case. The unit of EuRoC's names is removed, except for stamps."""
    name = name.lstrip("#").strip().lower()
    if name in _STAMP_COLUMNS:
        return name
    name = name.partition("[")[0].strip()
    for start, instead in _EUROC_NAME_ENDS.items():
        if name.startswith(start):
            return instead + name.removeprefix(start)
    return name.removesuffix("_m")
