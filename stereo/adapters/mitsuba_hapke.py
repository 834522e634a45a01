"""Hapke's reflectance for Mitsuba 3, as a BSDF in Python: the formula of Icy Moon's physics/surfaces/hapke.py.

    import mitsuba as mi
    mi.set_variant("llvm_ad_rgb")
    import mitsuba_hapke
    mitsuba_hapke.register()
    scene = mi.load_file("scene_left.xml")

Needs Mitsuba 3.6 or later in a variant that is not scalar, and nothing of Icy Moon. Register it after you chose the
variant. The parameters have the names of Icy Moon's settings: ``w``, ``b``, ``c``, ``b_s0``, ``h_s``, ``b_c0``,
``h_c``, ``theta_bar_deg``, ``k`` (the porosity factor) and ``h_function`` (1981, 1993 or 2002).

Directions are sampled by the cosine, so that a scene converges as with Lambert's law.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import mitsuba as mi

_NAMES = ("w", "b", "c", "b_s0", "h_s", "b_c0", "h_c", "theta_bar_deg", "k")
_DEFAULTS = {"w": 0.9, "k": 1.0}


def brdf(q: dict[str, Any], wi: mi.Vector3f, wo: mi.Vector3f) -> mi.Float:
    """Return the BRDF in 1/sr, radiance over irradiance, for unit vectors above a surface whose normal is z."""
    import drjit as dr

    cos_i, cos_o = dr.maximum(wi.z, 1e-6), dr.maximum(wo.z, 1e-6)
    near2, far2 = dr.squared_norm(wi - wo), dr.maximum(dr.squared_norm(wi + wo), 1e-30)
    b, c = q["b"], q["c"]

    def lobe(width: float) -> mi.Float:
        d = (1 - width) ** 2 + width * near2 if width >= 0 else (1 + width) ** 2 - width * far2
        return 1 / (d * dr.sqrt(d))

    single = (1 - b) * (1 + b) * (0.5 * (1 + c) * lobe(b) + 0.5 * (1 - c) * lobe(-b))
    tan_half = dr.sqrt(near2 / far2)
    if q["b_s0"] * q["h_s"] > 0:
        single *= 1 + q["b_s0"] * q["h_s"] / (q["h_s"] + tan_half)
    backscatter = 1.0
    if q["b_c0"] * q["h_c"] > 0:
        x = dr.maximum(dr.minimum(tan_half / q["h_c"], 1e12), 1e-3)
        backscatter = 1 + q["b_c0"] * (1 + (1 - dr.exp(-x)) / x) / (2 * (1 + x) ** 2)
    mu_n, mu_f, chi, shadowing = dr.maximum(cos_i, cos_o), dr.minimum(cos_i, cos_o), 1.0, 1.0
    tan_theta = math.tan(math.radians(q["theta_bar_deg"]))
    if tan_theta > 1e-5:
        mu_n, mu_f, shadowing = _apply_roughness(wi, wo, mu_n, mu_f, tan_theta)
        chi = 1 / math.sqrt(1 + math.pi * tan_theta**2)
    shadowing = shadowing / dr.maximum(mu_n + mu_f, 1e-12)
    multiple = (_h_function(chi * mu_n / q["k"], q) * _h_function(chi * mu_f / q["k"], q)) - 1
    return q["k"] * q["w"] / (4 * math.pi) * (single + multiple) * backscatter * shadowing


def _apply_roughness(
    wi: mi.Vector3f, wo: mi.Vector3f, mu_n: mi.Float, mu_f: mi.Float, tan_theta: float
) -> tuple[mi.Float, mi.Float, mi.Float]:
    """Return the effective cosines of the ray nearer to the normal and of the other ray, and the shadowing (Hapke
    1984).
    """
    import drjit as dr
    import mitsuba as mi

    sin_i, sin_o = (dr.sqrt(dr.maximum(1 - v.z * v.z, 0.0)) for v in (wi, wo))
    flat_i, flat_o = (mi.Vector2f(v.x, v.y) / dr.maximum(sin, 1e-7) for v, sin in ((wi, sin_i), (wo, sin_o)))
    apart, together = dr.norm(flat_i - flat_o), dr.maximum(dr.norm(flat_i + flat_o), 1e-7)
    tan_psi = apart / together
    side, turned, f = (tan_psi**2 / (1 + tan_psi**2), dr.atan2(apart, together) * 2 / math.pi, dr.exp(-2 * tan_psi))
    sin_n, sin_f = dr.minimum(sin_i, sin_o), dr.maximum(sin_i, sin_o)
    slope_n, slope_f = (mu / (dr.maximum(sin, 1e-7) * tan_theta) for mu, sin in ((mu_n, sin_n), (mu_f, sin_f)))
    e1_n, e1_f = (dr.exp(-2 / math.pi * dr.minimum(slope, 100.0)) for slope in (slope_n, slope_f))
    e2_n, e2_f = (dr.exp(-(dr.minimum(slope, 20.0) ** 2) / math.pi) for slope in (slope_n, slope_f))
    tilt_n, tilt_f = sin_n * tan_theta, sin_f * tan_theta
    eta_n, eta_f = mu_n + tilt_n * e2_n / (2 - e1_n), mu_f + tilt_f * e2_f / (2 - e1_f)
    whole = dr.maximum(2 - e1_f - turned * e1_n, 1e-7)
    shadowing = 1 / (eta_n * eta_f * (1 - f + f * mu_n / eta_n))
    mu_n = dr.maximum(mu_n + tilt_n * (e2_f + side * (e2_n - 2 * e2_f)) / whole, 0.0)
    mu_f = dr.maximum(mu_f + tilt_f * (e2_f - side * e2_n) / whole, 0.0)
    return mu_n, mu_f, shadowing * mu_n * mu_f


def _h_function(x: mi.Float, q: dict[str, Any]) -> mi.Float:
    import drjit as dr

    gamma = math.sqrt(max(1 - q["w"], 0.0))
    if q["h_function"] == 1981:
        return (1 + 2 * x) / (1 + 2 * gamma * x)
    r0, y = (1 - gamma) / (1 + gamma), dr.maximum(x, 1e-6)
    steep = dr.log((1 + y) / y)
    if q["h_function"] == 1993:
        return 1 / (1 - (1 - gamma) * y * (r0 + (1 - 0.5 * r0 - r0 * y) * steep))
    return 1 / (1 - q["w"] * y * (r0 + (0.5 - r0 * y) * steep))


def register() -> None:
    """Register the BSDF ``icymoon_hapke`` in Mitsuba, for the selected variant."""
    register_bsdf("icymoon_hapke", _read_parameters, brdf)


def _read_parameters(props: mi.Properties) -> dict[str, Any]:
    return {name: float(props.get(name, _DEFAULTS.get(name, 0.0))) for name in _NAMES} | {
        "h_function": int(props.get("h_function", 2002))
    }


def register_bsdf(
    plugin: str,
    read: Callable[[mi.Properties], dict[str, Any]],
    law: Callable[[dict[str, Any], mi.Vector3f, mi.Vector3f], mi.Float],
) -> None:
    """Register a BSDF as ``plugin``. ``read`` returns its parameters from properties, ``law`` is a function such as
    ``brdf``.
    """
    import drjit as dr
    import mitsuba as mi

    class ReflectanceLaw(mi.BSDF):
        """A BSDF with a reflectance law; black from below."""

        def __init__(self, props: mi.Properties) -> None:
            mi.BSDF.__init__(self, props)
            self.q = read(props)
            flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
            self.m_components, self.m_flags = [flags], flags

        def _is_seen(self, si: mi.SurfaceInteraction3f) -> mi.Bool:
            # A shading normal may turn away from a ray that meets the facet from above. The law then holds at grazing
            # emission.
            return dr.dot(si.n, si.to_world(si.wi)) > 0

        def _value(self, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: mi.Bool) -> mi.Color3f:
            lit = active & self._is_seen(si) & (wo.z > 0)
            return mi.Color3f(dr.select(lit, law(self.q, si.wi, wo) * wo.z, 0.0))

        def sample(
            self,
            ctx: mi.BSDFContext,
            si: mi.SurfaceInteraction3f,
            sample1: mi.Float,
            sample2: mi.Point2f,
            active: mi.Bool = True,
        ) -> tuple[mi.BSDFSample3f, mi.Color3f]:
            """Sample a direction by the cosine. Return it, and the BRDF times cosine over its density."""
            wo = mi.warp.square_to_cosine_hemisphere(sample2)
            found = mi.BSDFSample3f()
            found.wo, found.pdf, found.eta = wo, mi.warp.square_to_cosine_hemisphere_pdf(wo), 1.0
            found.sampled_type, found.sampled_component = mi.UInt32(+self.m_flags), mi.UInt32(0)
            valid = active & (found.pdf > 0)
            return found, dr.select(valid, self._value(si, wo, active) / dr.maximum(found.pdf, 1e-12), 0.0)

        def eval(
            self, ctx: mi.BSDFContext, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: mi.Bool = True
        ) -> mi.Color3f:
            """Return the BRDF times cosine."""
            return self._value(si, wo, active)

        def pdf(
            self, ctx: mi.BSDFContext, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: mi.Bool = True
        ) -> mi.Float:
            """Return the density of ``sample``."""
            return dr.select(active & self._is_seen(si) & (wo.z > 0), mi.warp.square_to_cosine_hemisphere_pdf(wo), 0.0)

        def eval_pdf(
            self, ctx: mi.BSDFContext, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: mi.Bool = True
        ) -> tuple[mi.Color3f, mi.Float]:
            """Return the BRDF times cosine, and the density of ``sample``."""
            return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

        def to_string(self) -> str:
            """Return the text for Mitsuba's messages."""
            return f"{plugin}[{self.q}]"

    mi.register_bsdf(plugin, ReflectanceLaw)
