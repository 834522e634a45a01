"""The Sun of a rendered scene, its only source for ``pair.json``, exports, index tables and reports.

Directions come from angles, a date or kernels, and the user may have turned the lamp by hand. Only the lamp at the time
of the render is true for the images. So angles follow from its direction and are stored for readers only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...support.arrays import Array
from .sky import azimuth_deg, elevation_deg

#: Source of a Sun whose lamp was changed by hand; other sources are choices of ``light.directions_from``.
BY_HAND = "HAND"
#: Largest difference between a lamp and the described Sun that counts as rounding: a turn of 0.0006°, or 0.001 % of
#: brightness.
_SAME_SUN = 1e-5


@dataclass(frozen=True)
class SceneSun:
    """The Sun, or a lamp near the ground in its place, as it lit the images. ``direction`` is the unit vector (3,)
    toward it in world axes. ``irradiance_wm2`` is on a facing surface at the origin of the site, less the part that the
    planet hides. ``distance_m`` is the lamp's distance, 0 for the Sun.
    """

    direction: Array
    irradiance_wm2: float
    angular_diameter_deg: float
    source: str = ""
    eclipse: float = 0.0
    distance_m: float = 0.0

    @property
    def elevation_deg(self) -> float:
        """Elevation in degrees of its centre above the horizon."""
        return elevation_deg(self.direction)

    @property
    def azimuth_deg(self) -> float:
        """Angle in degrees from north over east, 0 to 360."""
        return azimuth_deg(self.direction)

    @property
    def ground_irradiance_wm2(self) -> float:
        """Irradiance of level ground in W/m², without shadows."""
        return self.irradiance_wm2 * max(float(self.direction[2]), 0.0)

    def to_json(self) -> dict[str, Any]:
        """Return the table ``light.sun`` of ``pair.json``."""
        return {
            "source": self.source,
            "direction_to_world": self.direction.tolist(),
            "elevation_deg": self.elevation_deg,
            "azimuth_deg": self.azimuth_deg,
            "irradiance_wm2": self.irradiance_wm2,
            "angular_diameter_deg": self.angular_diameter_deg,
            "ground_irradiance_wm2": self.ground_irradiance_wm2,
            "eclipse": self.eclipse,
            **({"distance_m": self.distance_m} if self.distance_m else {}),
        }


def sun_from_facts(facts: Mapping[str, Any], source: str) -> SceneSun:
    """Make the Sun of ``sky.describe_sky`` as it lights a scene: without the part behind the planet, and dark below the
    horizon.
    """
    direction = np.array(facts["direction_to_world"])
    diameter, eclipse = facts["angular_diameter_deg"], facts["eclipse"]
    is_up = elevation_deg(direction) + diameter / 2 > 0
    return SceneSun(
        direction,
        facts["irradiance_wm2"] * (1.0 - eclipse) if is_up else 0.0,
        diameter,
        source,
        eclipse,
        facts.get("distance_m", 0.0),
    )


def sun_from_lamp(
    described: SceneSun, direction: Array, irradiance_wm2: float, angular_diameter_deg: float, distance_m: float
) -> SceneSun:
    """Make the Sun of a lamp that was made as ``described``; the user may have turned or changed it since."""
    stands = np.array([*direction, distance_m])
    same = np.allclose(
        stands, [*described.direction, described.distance_m], rtol=_SAME_SUN, atol=_SAME_SUN
    ) and np.allclose(
        [irradiance_wm2, angular_diameter_deg],
        [described.irradiance_wm2, described.angular_diameter_deg],
        rtol=_SAME_SUN,
        atol=1e-9,
    )
    shown = direction / np.linalg.norm(direction)
    if same:  # At a grazing Sun, the lamp's single precision would be a percent of the light of the images.
        return replace(described, direction=shown)
    return SceneSun(shown, irradiance_wm2, angular_diameter_deg, BY_HAND, distance_m=distance_m)


def sun_from_json(light: Any) -> SceneSun | None:
    """Read the Sun of the table ``light`` of ``pair.json``; None if the table has no valid Sun. In old pairs other
    numbers of the table may contradict its direction.
    """
    try:
        sun: Mapping[str, Any] = light["sun"]
        direction = np.array(sun["direction_to_world"], np.float64)
        numbers = [
            float(sun.get(key, 0.0)) for key in ("irradiance_wm2", "angular_diameter_deg", "eclipse", "distance_m")
        ]
        source = str(sun.get("source", ""))
    except (AttributeError, KeyError, TypeError, ValueError):
        return None
    if direction.shape != (3,) or not np.isfinite([*direction, *numbers]).all() or not direction.any():
        return None
    irradiance, diameter, eclipse, distance = numbers
    return SceneSun(direction / np.linalg.norm(direction), irradiance, diameter, source, eclipse, distance)
