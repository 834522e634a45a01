"""Exports sequences: frames with their true poses and stamps, and the optical flow between them.

* ``tum``: as the RGB-D benchmark of TUM, ``<sequence>/rgb/STAMP.png``, ``depth/STAMP.png`` (5000 steps per metre),
  their lists ``rgb.txt`` and ``depth.txt``, and ``groundtruth.txt``; the right eye's images are in ``right``.
* ``kitti-odometry``: as KITTI's odometry, ``sequences/00/image_2/000000.png``, ``image_3``, ``calib.txt``,
  ``times.txt`` and ``poses/00.txt``, from the axes of each left camera to the axes of the first.
* ``flow``: the flow of the left eye to the next frame (``forward``) and to the previous one (``backward``), in
  Middlebury's .flo and KITTI's 16-bit PNG, of all points (``_occ``) and of points that the other frame shows
  (``_noc``).

Pairs come in the order of time, see ``measure.sequences``; the pairs of one scene are a sequence. TUM's poses are in
the axes of the site, east, north and up.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path

import numpy as np

from ...formats.trajectories import format_pose
from ...physics.camera.optical_flow import Flow, find_flow
from ...physics.camera.rolling_shutter import RollingShutter
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import escape_cell, write_bytes, write_text
from ..images.develop import to_8_bit
from ..images.image_files import write_png
from ..measure.prepare_pair import LoadedPair
from ..measure.sequences import make_sequence_key
from . import Export
from .cameras import make_centred_matrix, read_middle_pose
from .encodings import encode_flo, quantise_flow, quantise_to_16_bits
from .losses import Each, Loss

TITLES = {
    "tum": "TUM RGB-D: frames of a sequence, depth and true poses",
    "kitti-odometry": "KITTI Odometry: frames of a sequence, times and true poses",
    "flow": "Optical Flow: flow to the next frame of a sequence and to the one before",
}
#: Steps per metre of depth in TUM's images.
_TUM_STEPS_PER_M = 5000.0


@dataclass
class _Sequence:
    """Frames of a sequence so far: its number, and one line per frame for each list file."""

    number: int
    lines: dict[str, list[str]] = field(default_factory=dict)
    frames: list[tuple[str, ...]] = field(default_factory=list)
    shutters: list[RollingShutter | None] = field(default_factory=list)
    last: LoadedPair | None = None

    def add(self, pair: LoadedPair, **lines: str) -> None:
        """Note a written frame."""
        for name, line in lines.items():
            self.lines.setdefault(name, []).append(line)
        self.frames.append((f"{len(self.frames):06d}", pair.settings.rig.stamp, escape_cell(pair.pair.folder.name)))
        self.shutters.append(pair.pair.rolling_shutter)

    def text(self, name: str, head: str = "") -> str:
        """Return the text of a list file."""
        return head + "".join(f"{line}\n" for line in self.lines.get(name, ()))

    def write_frames(self, path: Path) -> None:
        """Write the number, the stamp and the pair of each frame.

        If any frame has a rolling shutter, its readout time and motion are written too (see
        ``rolling_shutter.POSE_OF_ROW``).
        """
        heads = ("number", "stamp_s", "pair")
        rows = [heads, *self.frames]
        if any(self.shutters):
            motions = [_SHUTTER_COLUMNS, *map(_list_shutter, self.shutters)]
            rows = [(*row, *motion) for row, motion in zip(rows, motions, strict=True)]
        table = io.StringIO()
        csv.writer(table, lineterminator="\n").writerows(rows)
        write_text(path, table.getvalue())


_SHUTTER_COLUMNS = ("readout_s", "vx_m_s", "vy_m_s", "vz_m_s", "wx_deg_s", "wy_deg_s", "wz_deg_s")


def _list_shutter(shutter: RollingShutter | None) -> tuple[str, ...]:
    """List the values of ``_SHUTTER_COLUMNS``; zeros for a frame whose rows have one pose."""
    if shutter is None:
        return ("0.0",) * len(_SHUTTER_COLUMNS)
    values = [shutter.readout_s, *shutter.velocity_m_s, *shutter.turn_deg_s]
    return tuple(repr(float(value)) for value in values)


class _Sequences:
    """Sequences whose frames are the pairs of an export."""

    def __init__(self) -> None:
        self.known: dict[str, _Sequence] = {}

    def of(self, pair: LoadedPair) -> _Sequence:
        """Return the sequence of a pair. Raises IcyMoonError for a pair outside any sequence."""
        key = make_sequence_key(pair.pair.settings)
        if not key:
            raise IcyMoonError(
                f"{pair.pair.folder} is not a frame of a sequence; export pairs of a plan with a trajectory sweep."
            )
        return self.known.setdefault(key, _Sequence(len(self.known)))


def _find_image(pair: LoadedPair, eye: str) -> Array:
    return to_8_bit(pair.images.for_files(eye), pair.images.bits, pair.images.encoding)


def _write_tum(each: Each, out: Path) -> None:
    sequences = _Sequences()

    def write(pair: LoadedPair) -> list[Loss]:
        sequence = sequences.of(pair)
        root, stamp, pose = out / f"{sequence.number:04d}", pair.settings.rig.stamp, read_middle_pose(pair, "left")
        depth, losses = quantise_to_16_bits(pair.depth["left"], _TUM_STEPS_PER_M, "depth", "m")
        write_png(root / "rgb" / f"{stamp}.png", _find_image(pair, "left"))
        write_png(root / "right" / f"{stamp}.png", _find_image(pair, "right"))
        write_png(root / "depth" / f"{stamp}.png", depth)
        sequence.add(
            pair,
            rgb=f"{stamp} rgb/{stamp}.png",
            depth=f"{stamp} depth/{stamp}.png",
            groundtruth=f"{stamp} {format_pose(pose)}",
        )
        camera = pair.pair.camera
        matrix = make_centred_matrix(camera)
        sequence.lines["calibration"] = [
            " ".join(
                repr(float(v)) for v in (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], camera.baseline_m)
            )
        ]
        return losses

    each(write)
    heads = {
        "rgb": "# left images\n# timestamp filename\n",
        "depth": f"# planar depth, {_TUM_STEPS_PER_M:g} steps per metre, 0 for none\n# timestamp filename\n",
        "groundtruth": "# left camera, x right, y down, z forward, in axes east, north, up\n"
        "# timestamp tx ty tz qx qy qz qw\n",
        "calibration": "# fx fy cx cy in px from the centre of the first pixel, baseline in m\n",
    }
    for sequence in sequences.known.values():
        root = out / f"{sequence.number:04d}"
        for name, head in heads.items():
            write_text(root / f"{name}.txt", sequence.text(name, head))
        sequence.write_frames(root / "frames.csv")


def _write_kitti_odometry(each: Each, out: Path) -> None:
    sequences = _Sequences()
    first: dict[int, tuple[Array, Decimal]] = {}

    def write(pair: LoadedPair) -> None:
        sequence = sequences.of(pair)
        root, name = out / "sequences" / f"{sequence.number:02d}", f"{len(sequence.frames):06d}.png"
        pose, stamp = read_middle_pose(pair, "left"), Decimal(pair.settings.rig.stamp)
        start, began = first.setdefault(sequence.number, (pose, stamp))
        turn = start[:3, :3].T
        relative = np.column_stack([turn @ pose[:3, :3], turn @ (pose[:3, 3] - start[:3, 3])])
        for folder, eye in (("image_2", "left"), ("image_3", "right")):
            write_png(root / folder / name, _find_image(pair, eye))
        camera = pair.pair.camera
        matrix = np.column_stack([make_centred_matrix(camera), np.zeros(3)])
        calibration = []
        for k in range(4):  # 0 and 2 are the left eye, 1 and 3 the right one
            matrix[0, 3] = -camera.focal_baseline_px_m * (k % 2)
            calibration.append(f"P{k}: {' '.join(f'{value:.12e}' for value in matrix.ravel())}")
        sequence.lines["calib"] = calibration
        sequence.add(
            # With KITTI's own six decimals, neighbouring frames of long sequences would have equal times.
            pair,
            times=f"{float(stamp - began):.15e}",
            poses=" ".join(f"{value:.12e}" for value in relative.ravel()),
        )

    each(write)
    for sequence in sequences.known.values():
        root = out / "sequences" / f"{sequence.number:02d}"
        write_text(root / "calib.txt", sequence.text("calib"))
        write_text(root / "times.txt", sequence.text("times"))
        write_text(out / "poses" / f"{sequence.number:02d}.txt", sequence.text("poses"))
        sequence.write_frames(root / "frames.csv")


def _write_flow(each: Each, out: Path) -> None:
    """Write the flow between neighbouring frames of each sequence, with two frames in memory at a time."""
    sequences = _Sequences()

    def write(pair: LoadedPair) -> list[Loss]:
        sequence = sequences.of(pair)
        root, number = out / f"{sequence.number:04d}", len(sequence.frames)
        write_png(root / "image" / f"{number:06d}.png", _find_image(pair, "left"))
        losses: list[Loss] = []
        if sequence.last is not None:
            for way, frame, here, there in (
                ("forward", number - 1, sequence.last, pair),
                ("backward", number, pair, sequence.last),
            ):
                losses += _write_one_flow(root, way, f"{frame:06d}", compute_flow_between(here, there))
        sequence.last = pair
        sequence.add(pair)
        return losses

    each(write)
    for sequence in sequences.known.values():
        sequence.write_frames(out / f"{sequence.number:04d}" / "frames.csv")


def compute_flow_between(here: LoadedPair, there: LoadedPair) -> Flow:
    """Compute the flow of the left rectified eye from a pair to another with the same camera."""
    return find_flow(
        here.pair.camera,
        here.depth["left"],
        read_middle_pose(here, "left"),
        there.depth["left"],
        read_middle_pose(there, "left"),
        here.pair.rolling_shutter,
        there.pair.rolling_shutter,
    )


def _write_one_flow(root: Path, way: str, name: str, flow: Flow) -> list[Loss]:
    write_bytes(root / way / f"{name}.flo", encode_flo(flow.flow_px))
    steps, losses = quantise_flow(flow.flow_px)
    write_png(root / f"{way}_occ" / f"{name}.png", steps)
    write_png(root / f"{way}_noc" / f"{name}.png", np.where(flow.visible[..., None], steps, 0).astype(np.uint16))
    return losses


TUM = Export(write_all=_write_tum)
KITTI_ODOMETRY = Export(write_all=_write_kitti_odometry)
FLOW = Export(write_all=_write_flow)
