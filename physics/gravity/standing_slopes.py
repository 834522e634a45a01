"""Gravity of the moons, and the slopes that strength holds against it.

Ground with cohesion c and angle of friction φ fails on a plane of dip θ when the weight above the plane exceeds the
shear strength there (Coulomb's law). Culmann's wedge lies on such a plane. Of all planes through the foot of a face of
slope β, the one at θ = (β + φ) / 2 fails first, so the face stands up to the height

    H(β) = (4 c / (ρ g)) sin β cos φ / (1 - cos(β - φ)),

which is (4 c / (ρ g)) tan(45° + φ / 2) for an upright face. Heights and lengths are proportional to c / (ρ g), and the
angle of repose of loose material does not change with g.
"""

from __future__ import annotations

import math

from ...support.errors import IcyMoonError

#: Gravity at the mean radius in m/s²: GM / R². GM in km³/s²: 3202.7121 and 7.2103667 (JPL, gm_Horizons.pck of
#: 2025-01-29, from the satellite solutions; Enceladus' from SAT441L. Jacobson et al. 2006, AJ 132, 2520, table 3, has
#: 7.2096 ± 0.0067). R in km: 1560.8 and 252.1 (Archinal et al. 2018).
GRAVITY_M_S2 = {"EUROPA": 3202.7121e9 / 1560.8e3**2, "ENCELADUS": 7.2103667e9 / 252.1e3**2}


def find_gravity_m_s2(stated_m_s2: float, body: str, setting: str) -> float:
    """Return gravity in m/s²: the stated value if it is above 0, else the moon's. Raises IcyMoonError if the moon's is
    unknown; the error names the ``setting`` that can state it.
    """
    if stated_m_s2 > 0:
        return stated_m_s2
    if body.upper() not in GRAVITY_M_S2:
        raise IcyMoonError(
            f"The gravity of {body.upper()} is unknown, but it decides whether walls stand; state {setting}."
        )
    return GRAVITY_M_S2[body.upper()]


def critical_height_m(cohesion_pa: float, friction_deg: float, density_kg_m3: float, gravity_m_s2: float) -> float:
    """Compute the height in metres up to which a vertical cut stands: H = 4 c tan(45° + φ/2) / (ρ g).

    The law is Culmann's wedge; Marteau et al. (LPSC 2021, #2067) used it for the walls of InSight's pits.
    """
    return 4.0 * cohesion_pa / (density_kg_m3 * gravity_m_s2) * math.tan(math.radians(45.0 + friction_deg / 2.0))
