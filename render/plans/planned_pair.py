"""The pairs that settings ask for. Imports no Blender."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...physics.camera.blur import describe_blur_identity
from ...physics.random_numbers.seeds import seed_stream
from ...settings.description import merged
from ...settings.pair_ids import make_pair_id
from ...settings.topics.scene import Settings
from ..pairs.dataset_file_names import folder_of_pair
from .baked_or_traced import choose_indirect


@dataclass(frozen=True)
class PlannedPair:
    """One pair to render: its id, its complete settings, and the angle of its rig. The rig of a scene that is built
    already turns by this angle for the pair; in a scene built from the pair's settings it is 0."""

    id: str
    settings: Settings
    turn_deg: float

    def folder(self, dataset: Path) -> Path:
        """Return the folder of the finished pair."""
        return folder_of_pair(dataset, self.id)

    @property
    def render_seed(self) -> int:
        """Seed of Cycles' sampling: different for each pair, equal for equal pairs."""
        state = seed_stream(int(self.settings.dataset.seed), "render", int(self.id, 16)).generate_state(1)
        return int(state[0] >> 1)


def compute_heading_deg(settings: Settings, k: int, headings: int) -> float:
    """Compute heading ``k`` of ``headings`` in equal steps, degrees; heading 0 is ``rig.heading_deg``."""
    heading = float(settings.rig.heading_deg) + 360.0 * k / headings
    return float(f"{heading - 360.0 if heading > 180.0 and k else heading:.6g}")


def expand_headings(settings: Settings, extra: str = "") -> list[PlannedPair]:
    """List the pairs of complete settings: ``dataset.headings`` headings in equal steps at the site.

    ``extra`` identifies content beside the settings, see ``settings.pair_ids.make_pair_id``. Raises IcyMoonError for
    blur that cannot be rendered.
    """
    headings = int(settings.dataset.headings)
    described = choose_indirect(
        [
            merged(settings, {"rig": {"heading_deg": compute_heading_deg(settings, k, headings)}} if k else {})
            for k in range(headings)
        ]
    )
    return [
        PlannedPair(make_pair_id(turned, extra + describe_blur_identity(turned)), turned, 360.0 * k / headings)
        for k, turned in enumerate(described)
    ]
