"""Whether the walls of a trench stand, and how heavy things are on a moon."""

from __future__ import annotations

import math

#: Gravity at the mean radius in m/s²: GM / R². GM in km³/s²: 3202.7121 and 7.2103667 (JPL, gm_Horizons.pck of
#: 2025-01-29, from the satellite solutions; Enceladus' from SAT441L. Jacobson et al. 2006, AJ 132, 2520, table 3, has
#: 7.2096 ± 0.0067). R in km: 1560.8 and 252.1 (Archinal et al. 2018).
GRAVITY_M_S2 = {"EUROPA": 3202.7121e9 / 1560.8e3**2, "ENCELADUS": 7.2103667e9 / 252.1e3**2}


def critical_height_m(cohesion_pa: float, friction_deg: float, density_kg_m3: float, gravity_m_s2: float) -> float:
    """The height in metres up to which a vertical cut stands: 4 c tan(45° + φ/2) / (ρ g).

    Culmann's wedge; used for the walls of InSight's pits by Marteau et al. (LPSC 2021, #2067).
    """
    return 4.0 * cohesion_pa / (density_kg_m3 * gravity_m_s2) * math.tan(math.radians(45.0 + friction_deg / 2.0))
