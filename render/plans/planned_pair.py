"""Which pairs a description asks for. Imports no Blender."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...physics.camera.blur import describe_blur_identity
from ...physics.random_numbers.seeds import seed_stream
from ...settings.description import digest, merged
from ...settings.topics.scene import Settings
from ..pairs.dataset_file_names import folder_of_pair
from .baked_or_traced import choose_indirect


@dataclass(frozen=True)
class PlannedPair:
    """One pair to render: its complete settings, its id, and by how much the rig of a scene that is built already
    is turned for it (a scene that is built from the settings stands right)."""

    id: str
    settings: Settings
    turn_deg: float

    def folder(self, dataset: Path) -> Path:
        """Where the finished pair lies."""
        return folder_of_pair(dataset, self.id)

    @property
    def render_seed(self) -> int:
        """Seed of Cycles' sampling: another one for every pair, the same for the same pair."""
        state = seed_stream(int(self.settings.dataset.seed), "render", int(self.id, 16)).generate_state(1)
        return int(state[0] >> 1)


def turned_heading_deg(settings: Settings, k: int, headings: int) -> float:
    """Heading of turn ``k`` of ``headings`` equal turns; turn 0 has ``rig.heading_deg``."""
    heading = float(settings.rig.heading_deg) + 360.0 * k / headings
    return float(f"{heading - 360.0 if heading > 180.0 and k else heading:.6g}")


def expand_headings(settings: Settings, extra: str = "") -> list[PlannedPair]:
    """The pairs of a complete description: ``dataset.headings`` equal turns at the site.

    ``extra`` identifies content that the settings do not describe (see ``description.digest``). Raises IcyMoonError for
    blur that cannot be rendered.
    """
    headings = int(settings.dataset.headings)
    described = choose_indirect(
        [
            merged(settings, {"rig": {"heading_deg": turned_heading_deg(settings, k, headings)}} if k else {})
            for k in range(headings)
        ]
    )
    return [
        PlannedPair(digest(turned, extra + describe_blur_identity(turned)), turned, 360.0 * k / headings)
        for k, turned in enumerate(described)
    ]
