"""Small random movements of the camera between the states of an excavation."""

from __future__ import annotations

from ...settings.topics.camera import RigSettings
from ...settings.topics.scene import Settings
from ..random_numbers.seeds import make_generator
from .dig_site import is_dug


def jitter_rig(settings: Settings) -> RigSettings:
    """Add the random offsets of the excavation state to the rig of complete ``settings``.

    Position on three axes, heading and pitch have normally distributed offsets, with the standard deviations
    ``jitter_m`` and ``jitter_deg``. They depend only on the seed of the data set and the state.
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
