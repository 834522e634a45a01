"""What a scan by a laser scanner is asked for, as a word of a command line. Imports no Blender."""

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

#: Effects beside those of a detector that can be left out.
_OTHER_EFFECTS = ("ice", "detector", "sunlight", "patches")
EFFECTS = (*_OTHER_EFFECTS, *vars(Effects()))


@dataclass(frozen=True)
class ScanRequest:
    """What a scan is asked for: a pose x, y, z in metres and a quaternion w, x, y, z (empty: at the left eye); rows,
    columns, rays and returns in place of the scanner's; effects to leave out, see ``EFFECTS``; grain radius in metres
    and density in kg/m³ of snow in place of the scene's; seed of the detector (None: the scene's) and number of the
    scan; samples of a packet of waveforms (None: no waveforms)."""

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
        """The request as a word of a command line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> ScanRequest:
        """The request of such a word."""
        stated = parse_json(text)
        return cls(**(stated | {key: tuple(stated[key]) for key in ("pose", "without")}))

    def read_scanner(self, path: Path) -> LidarFile:
        """The scanner of a file as it is asked for. Raises IcyMoonError for an impossible one."""
        lidar = self.change(read_lidar(path))
        if self.waveforms is not None:
            make_digitiser(lidar.detector, lidar.instrument, self.waveforms)
        return lidar

    def change(self, lidar: LidarFile) -> LidarFile:
        """A scanner as it is asked for. Raises IcyMoonError for an impossible one."""
        changed = change_lidar(lidar, self.rows, self.columns, self.rays, cast(Reported | None, self.returns))
        return replace(changed, detector=None) if "detector" in self.without else changed
