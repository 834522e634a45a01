"""Whether the walls of a trench stand, and how heavy things are on a moon."""

from __future__ import annotations

import math

#: Gravity at the mean radius in m/s²: GM / R². Europa: GM 3202.71 km³/s² (Jacobson 2021, JUP365), R 1560.8 km;
#: Enceladus: GM 7.2105 km³/s² (Jacobson 2022, AJ 164, 199), R 252.1 km (radii: Archinal et al. 2018).
GRAVITY_M_S2 = {"EUROPA": 3202.71e9 / 1560.8e3**2, "ENCELADUS": 7.2105e9 / 252.1e3**2}


def critical_height_m(cohesion_pa: float, friction_deg: float, density_kg_m3: float, gravity_m_s2: float) -> float:
    """The height in metres up to which a vertical cut stands: 4 c tan(45° + φ/2) / (ρ g).

    Culmann's wedge; used for the walls of InSight's pits by Marteau et al. (LPSC 2021, #2067).
    """
    return (4.0 * cohesion_pa / (density_kg_m3 * gravity_m_s2)
            * math.tan(math.radians(45.0 + friction_deg / 2.0)))
