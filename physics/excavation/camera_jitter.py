"""How the camera of a series of excavation states moves a little from state to state."""

from __future__ import annotations

from ...settings.topics.camera import RigSettings
from ...settings.topics.scene import Settings
from ..random_numbers.seeds import make_generator
from .dig_site import is_dug


def jitter_rig(settings: Settings) -> RigSettings:
    """The rig of complete ``settings`` with the random offsets of its state of the excavation.

    Position on three axes, heading and pitch are normal, with the deviations ``jitter_m`` and ``jitter_deg``. They
    depend on the seed of the data set and on the state alone.
    """
    excavation, rig = settings.excavation, settings.rig
    if not is_dug(settings) or (excavation.jitter_m == 0.0 and excavation.jitter_deg == 0.0):
        return rig
    random = make_generator(int(settings.dataset.seed), "plan", 0, int(excavation.state))
    east, north, up, turn, nod = random.standard_normal(5)
    return rig | {
        "x_m": rig.x_m + excavation.jitter_m * float(east),
        "y_m": rig.y_m + excavation.jitter_m * float(north),
        "height_m": rig.height_m + excavation.jitter_m * float(up),
        "heading_deg": rig.heading_deg + excavation.jitter_deg * float(turn),
        "pitch_deg": rig.pitch_deg + excavation.jitter_deg * float(nod),
    }
