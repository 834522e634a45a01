"""The reflectance of snow for Mitsuba 3, as a BSDF in Python: the formula of Icy Moon's physics/surfaces/snow.py.

    import mitsuba as mi
    mi.set_variant("llvm_ad_rgb")
    import mitsuba_snow
    mitsuba_snow.register()
    scene = mi.load_file("scene_left.xml")

Needs ``mitsuba_hapke.py`` beside it, and the packages of that file. The parameter is ``albedo``, the spherical one.
Source: Kokhanovsky and Zege 2004, Applied Optics 43, 1589.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import mitsuba as mi

#: The constants of physics/surfaces/snow.py.
_LEVEL, _LINEAR, _PRODUCT, _PHASE, _MIN_COSINES = 1.247, 1.186, 5.157, ((11.1, 0.087), (1.1, 0.014)), 0.2


def brdf(q: dict[str, Any], wi: mi.Vector3f, wo: mi.Vector3f) -> mi.Float:
    """Return the BRDF in 1/sr, radiance over irradiance, for unit vectors above a surface whose normal is z."""
    import drjit as dr

    mu0, mu = dr.maximum(wo.z, 0.0), dr.maximum(wi.z, 0.0)
    both = dr.maximum(mu0 + mu, _MIN_COSINES)
    scattering_deg = 180 - 2 * dr.rad2deg(dr.atan2(dr.norm(wi - wo), dr.norm(wi + wo)))
    white = _LEVEL + _LINEAR * both + _PRODUCT * mu0 * mu
    for amplitude, decay in _PHASE:
        white += amplitude * dr.exp(-decay * scattering_deg)
    white /= 4 * both
    escapes = (3 / 7) ** 2 * (1 + 2 * mu0) * (1 + 2 * mu)
    return white * dr.exp(math.log(max(q["albedo"], 1e-6)) * escapes / white) / math.pi


def register() -> None:
    """Register the BSDF ``icymoon_snow`` in Mitsuba, for the selected variant."""
    from mitsuba_hapke import register_bsdf

    register_bsdf("icymoon_snow", lambda props: {"albedo": float(props.get("albedo", 0.9))}, brdf)
