"""The request for a scan by a laser scanner, as one word of a command line. Imports no Blender."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import cast

from ...formats.lidar_file import LidarFile, change_lidar, read_lidar
from ...physics.lidar.digitiser import make_digitiser
from ...physics.lidar.noise_streams import Effects
from ...physics.lidar.returns import Reported
from ...support.foreign_bytes import parse_json

#: Effects that can be left out, beside the effects of a detector.
_OTHER_EFFECTS = ("ice", "detector", "sunlight", "patches")
EFFECTS = (*_OTHER_EFFECTS, *vars(Effects()))


@dataclass(frozen=True)
class ScanRequest:
    """A request for a scan. ``pose`` is x, y, z in metres and a quaternion w, x, y, z; empty for the pose of the left
    eye. ``rows``, ``columns``, ``rays`` and ``returns`` replace the scanner's values. ``without`` names effects of
    ``EFFECTS`` to leave out. ``grain_m``, the grain radius, and ``density_kg_m3`` replace the values of the scene's
    snow. ``seed`` is the seed of the detector, None for the scene's seed. ``scan`` is the number of the scan.
    ``waveforms`` are the samples of a packet, None without waveforms.
    """

    pose: tuple[float, ...] = ()
    rows: int | None = None
    columns: int | None = None
    rays: int | None = None
    returns: str | None = None
    without: tuple[str, ...] = ()
    grain_m: float | None = None
    density_kg_m3: float | None = None
    seed: int | None = None
    scan: int = 0
    waveforms: int | None = None

    def to_json(self) -> str:
        """Return the request as one word of a command line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> ScanRequest:
        """Parse the request from the text of ``to_json``."""
        stated = parse_json(text)
        return cls(**(stated | {key: tuple(stated[key]) for key in ("pose", "without")}))

    def read_scanner(self, path: Path) -> LidarFile:
        """Read the scanner of a file, and change it by this request. Raises IcyMoonError for an impossible scanner."""
        lidar = self.change(read_lidar(path))
        if self.waveforms is not None:
            make_digitiser(lidar.detector, lidar.instrument, self.waveforms)
        return lidar

    def change(self, lidar: LidarFile) -> LidarFile:
        """Return a scanner that is changed by this request. Raises IcyMoonError for an impossible scanner."""
        changed = change_lidar(lidar, self.rows, self.columns, self.rays, cast(Reported | None, self.returns))
        return replace(changed, detector=None) if "detector" in self.without else changed
