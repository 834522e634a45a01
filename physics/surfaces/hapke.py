"""Hapke's bidirectional reflectance of a particulate surface, the double-precision reference.

The law is the isotropic multiple-scattering approximation (IMSA) with the two opposition effects, roughness and
porosity:

    r = K w/4π · µ0e/(µ0e+µe) · [p(g)(1 + BS0 BS(g)) + H(µ0e/K) H(µe/K) - 1] · (1 + BC0 BC(g)) · S(i,e,ψ;θ̄)

r is radiance over the irradiance of a surface that faces the Sun, in 1/sr; i is the incidence and e the emission angle,
ψ the azimuth between them (0: the Sun behind the observer), g the phase angle.

Sources: B. Hapke, Theory of Reflectance and Emittance Spectroscopy, 2nd ed. 2012 (the formula); Hapke 1981, JGR 86,
3039 (H, "1981"); 1984, Icarus 59, 41 (roughness); 1986, Icarus 67, 264 (shadow hiding); 1993, the book's first edition
(H, "1993"); 2002, Icarus 157, 523 (H "2002", coherent backscatter); 2008, Icarus 195, 918 (porosity).

Nothing here takes the arc cosine of a dot product, because near opposition that loses half of the digits.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ...settings.topics.surfaces import HapkeSettings
from ...support.arrays import Array, Numbers
from ...support.errors import IcyMoonError

H_FUNCTIONS = ("1981", "1993", "2002")
#: Filling factor f at which K = -ln(1 - 1.209 f^(2/3)) / (1.209 f^(2/3)) becomes infinite.
CLOSEST_PACKING = 1.209**-1.5
_TINY = 1e-300  # makes 0/0 forms finite and changes nothing else


@dataclass(frozen=True)
class HapkeParameters:
    """Parameters of the model; numbers, or arrays that broadcast with each other and with the angles.

    w: single-scattering albedo, 0 to 1.
    b, c: two-lobed Henyey-Greenstein phase function in Hapke's 2012 convention. |b| < 1 is the width of the lobes, and
      (1 + c)/2 the share of the lobe toward the source. c may leave [-1, 1] as far as the phase function stays
      non-negative. ``single_lobe(ξ)`` is one lobe of asymmetry ξ = <cos scattering angle>; McGuire's and ISIS' c' is
      (1 + c)/2.
    b_s0, h_s: amplitude and half-width parameter of the shadow-hiding opposition effect.
    b_c0, h_c: amplitude and half-width parameter of coherent backscatter.
    theta_bar: mean slope angle of the unresolved roughness, in radians, 0 to < π/2.
    filling_factor: share of the volume that grains fill, 0 (K = 1) to < 0.7522.
    h_function: "1981", "1993" or "2002", the approximation of the H function. Parameters belong to the H function with
      which they were fitted.

    Raises IcyMoonError where a parameter is physically impossible.
    """

    w: Numbers
    b: Numbers = 0.0
    c: Numbers = 0.0
    b_s0: Numbers = 0.0
    h_s: Numbers = 0.0
    b_c0: Numbers = 0.0
    h_c: Numbers = 0.0
    theta_bar: Numbers = 0.0
    filling_factor: Numbers = 0.0
    h_function: str = "2002"

    def __post_init__(self) -> None:
        if self.h_function not in H_FUNCTIONS:
            raise IcyMoonError(f"Hapke: h_function is {self.h_function!r}, known are {', '.join(H_FUNCTIONS)}.")
        for field in fields(self):
            if field.name != "h_function":
                values = np.asarray(getattr(self, field.name), np.float64)
                if not np.isfinite(values).all():
                    raise IcyMoonError(f"Hapke: {field.name} is not a finite number; give one.")
        self._refuse_out_of_range(
            "w", 0.0, 1.0, "a grain scatters at least nothing and at most all of the light it meets"
        )
        self._refuse_out_of_range("b", -1.0, 1.0, "at 1 the lobe is a ray", open_ends=True)
        for name in ("b_s0", "h_s", "b_c0", "h_c"):
            self._refuse_out_of_range(name, 0.0, np.inf, "an opposition effect only brightens, over some angle")
        self._refuse_out_of_range("theta_bar", 0.0, np.pi / 2, "it is a mean slope in radians", open_high=True)
        self._refuse_out_of_range(
            "filling_factor", 0.0, CLOSEST_PACKING, "grains cannot be packed closer", open_high=True
        )
        # The smaller of p(0) and p(π); p is monotonic wherever one lobe counts negative.
        if np.any(np.minimum(*(phase_function(g, self.b, self.c) for g in (0.0, np.pi))) < 0.0):
            raise IcyMoonError(
                f"Hapke: c is {self._format_parameter('c')}, which makes the phase function negative with this b; "
                "-1 to 1 is right for every b."
            )

    def _format_parameter(self, name: str) -> str:
        values = np.asarray(getattr(self, name), np.float64)
        return f"{values:g}" if values.ndim == 0 else f"{values.min():g} to {values.max():g}"

    def _refuse_out_of_range(
        self, name: str, low: float, high: float, why: str, open_ends: bool = False, open_high: bool = False
    ) -> None:
        values = np.asarray(getattr(self, name), np.float64)
        below = values <= low if open_ends else values < low
        above = values >= high if open_ends or open_high else values > high
        if np.any(below | above):
            side = (
                f"at least {low:g}"
                if high == np.inf
                else f"{'above' if open_ends else 'from'} {low:g} {'and below' if open_ends or open_high else 'to'} "
                f"{high:.5g}"
            )
            raise IcyMoonError(f"Hapke: {name} is {self._format_parameter(name)}, it must be {side}: {why}.")


def hapke_from_settings(hapke: HapkeSettings) -> HapkeParameters:
    """Make the parameters that ``hapke`` settings describe. Raises IcyMoonError if they are physically impossible."""
    same = ("w", "b", "c", "b_s0", "h_s", "b_c0", "h_c", "filling_factor")
    return HapkeParameters(
        **{key: hapke[key] for key in same}, theta_bar=np.radians(hapke.theta_bar_deg), h_function=hapke.h_function
    )


def single_lobe(asymmetry: float) -> dict[str, float]:
    """Return b and c of a one-term Henyey-Greenstein function with ξ = <cos scattering angle>, which is negative for
    backscatter.
    """
    return {"b": abs(asymmetry), "c": -1.0 if asymmetry > 0 else 1.0}


def phase_function(phase: Numbers, b: Numbers, c: Numbers) -> Array:
    """Compute the two-lobed Henyey-Greenstein p at phase angles in radians, mean 1 over the sphere (Hapke 2012, eq.
    6.7).
    """
    return _phase_function(
        np.sin(np.asarray(phase, np.float64) / 2) ** 2, np.cos(np.asarray(phase, np.float64) / 2) ** 2, b, c
    )


def _phase_function(sin2_half: Array, cos2_half: Array, b: Numbers, c: Numbers) -> Array:
    b, c = np.asarray(b, np.float64), np.asarray(c, np.float64)
    # (1-b)² + 4b sin²(g/2) = 1 - 2b cos g + b², without the cancellation where b and cos g near 1; for b < 0 the
    # same from the other side.
    toward = np.where(b >= 0, (1 - b) ** 2 + 4 * b * sin2_half, (1 + b) ** 2 - 4 * b * cos2_half)
    away = np.where(b >= 0, (1 - b) ** 2 + 4 * b * cos2_half, (1 + b) ** 2 - 4 * b * sin2_half)
    lobes: Array = (1 - b) * (1 + b) * ((1 + c) / 2 * toward**-1.5 + (1 - c) / 2 * away**-1.5)
    return lobes


def h_function(x: Numbers, w: Numbers, kind: str = "2002") -> Array:
    """Approximate Chandrasekhar's H(x) for isotropic scatterers of albedo w, where x is the cosine of the angle.

    Largest errors at w = 1: "1981" 4 %, "1993" and "2002" 0.8 %.
    """
    x, w = np.asarray(x, np.float64), np.asarray(w, np.float64)
    gamma = np.sqrt(np.maximum(1 - w, 0.0))
    result: Array
    if kind == "1981":
        result = (1 + 2 * x) / (1 + 2 * gamma * x)
        return result
    r0 = (1 - gamma) / (1 + gamma)
    logarithm = np.log1p(1 / np.maximum(x, _TINY))
    if kind == "1993":
        result = 1 / (1 - (1 - gamma) * x * (r0 + (1 - r0 / 2 - r0 * x) * logarithm))
    else:
        result = 1 / (1 - w * x * (r0 + (1 - 2 * r0 * x) / 2 * logarithm))
    return result


def porosity_factor(filling_factor: Numbers) -> Array:
    """Compute K of Hapke 2008: 1 for loose powder, larger the denser the grains are packed."""
    y = 1.209 * np.cbrt(np.asarray(filling_factor, np.float64)) ** 2
    factor: Array = np.where(y > 0, -np.log1p(-y) / np.maximum(y, _TINY), 1.0)
    return factor


def shadow_hiding(tan_half: Numbers, h_s: Numbers) -> Array:
    """Compute B_S = 1/(1 + tan(g/2)/h_S); 0 where the half-width is 0."""
    h = np.asarray(h_s, np.float64)
    surge: Array = np.where(h > 0, h / np.maximum(h + tan_half, _TINY), 0.0)
    return surge


def coherent_backscatter(tan_half: Numbers, h_c: Numbers) -> Array:
    """Compute B_C = [1 + (1 - e^-x)/x] / 2(1 + x)², x = tan(g/2)/h_C; 0 where the half-width is 0."""
    h = np.asarray(h_c, np.float64)
    x = np.asarray(tan_half, np.float64) / np.maximum(h, _TINY)
    ratio = np.where(x > 0, -np.expm1(-x) / np.maximum(x, _TINY), 1.0)
    surge: Array = np.where(h > 0, (1 + ratio) / (2 * (1 + x) ** 2), 0.0)
    return surge


def _apply_roughness(incidence: Array, emission: Array, psi: Array, theta_bar: Array) -> tuple[Array, Array, Array]:
    """Compute the effective cosines µ0e and µe and the shadowing function S (Hapke 1984; 2012, section 12.4).

    The smooth limit needs no special case: with θ̄ = 0, cot θ̄ is infinite and every exponential 0.
    """
    tan_theta = np.tan(theta_bar)
    cot_theta = 1 / tan_theta
    chi = 1 / np.sqrt(1 + np.pi * tan_theta**2)

    def terms(angle: Array) -> tuple[Array, Array, Array, Array]:
        cos, tilt = np.cos(angle), np.sin(angle) * tan_theta
        slope = cot_theta / np.tan(angle)
        not_e1, e2 = -np.expm1(-2 / np.pi * slope), np.exp(-(slope**2) / np.pi)
        return tilt, not_e1, e2, chi * (cos + tilt * e2 / (1 + not_e1))

    # One formula for the ray nearer to the normal and the ray farther from it: the papers' cases i <= e and e <= i
    # differ only in which of the two is the Sun's.
    near, far = np.minimum(incidence, emission), np.maximum(incidence, emission)
    tilt_n, not_e1_n, e2_n, eta_n = terms(near)
    tilt_f, not_e1_f, e2_f, eta_f = terms(far)
    cos_n, cos_f, side = np.cos(near), np.cos(far), np.sin(psi / 2) ** 2
    turned = psi / np.pi
    whole = not_e1_f + (1 - turned) + turned * not_e1_n  # 2 - E1(far) - ψ/π E1(near)
    mu_n = chi * (cos_n + tilt_n * (np.cos(psi) * e2_f + side * e2_n) / whole)
    mu_f = chi * (cos_f + tilt_f * (e2_f - side * e2_n) / whole)
    seen_first = incidence <= emission
    mu0_e, mu_e = np.where(seen_first, mu_n, mu_f), np.where(seen_first, mu_f, mu_n)
    eta_0, eta = np.where(seen_first, eta_n, eta_f), np.where(seen_first, eta_f, eta_n)
    f = np.exp(-2 * np.tan(psi / 2))
    shadowing = mu_e / eta * np.cos(incidence) / eta_0 * chi / (1 - f + f * chi * cos_n / eta_n)
    return np.maximum(mu0_e, 0.0), np.maximum(mu_e, 0.0), np.maximum(shadowing, 0.0)


def bidirectional_reflectance(
    incidence: Numbers, emission: Numbers, azimuth: Numbers, parameters: HapkeParameters
) -> Array:
    """Compute the bidirectional reflectance r in 1/sr at angles in radians that broadcast, azimuth 0 on the Sun's side.

    It is 0 where the Sun is at or below the surface's horizon or the observer is below it. π r is the radiance factor
    I/F, r / cos(incidence) the BRDF.
    """
    q = parameters
    i, e, psi = (np.asarray(angle, np.float64) for angle in (incidence, emission, azimuth))
    i, e, psi = np.abs(i), np.abs(e), np.abs(np.remainder(psi + np.pi, 2 * np.pi) - np.pi)
    lit = (i < np.pi / 2) & (e <= np.pi / 2)
    i, e = np.where(lit, i, 0.0), np.where(lit, e, 0.0)
    # The two halves of the phase angle without cos g.
    around = np.sin(i) * np.sin(e)
    sin2_half = np.sin((i - e) / 2) ** 2 + around * np.sin(psi / 2) ** 2
    cos2_half = np.cos((i + e) / 2) ** 2 + around * np.cos(psi / 2) ** 2
    tan_half = np.sqrt(sin2_half / cos2_half)
    with np.errstate(divide="ignore", over="ignore", under="ignore"):
        mu0_e, mu_e, shadowing = _apply_roughness(i, e, psi, np.asarray(q.theta_bar, np.float64))
        k = porosity_factor(q.filling_factor)
        single = _phase_function(sin2_half, cos2_half, q.b, q.c) * (
            1 + np.asarray(q.b_s0) * shadow_hiding(tan_half, q.h_s)
        )
        multiple = h_function(mu0_e / k, q.w, q.h_function) * h_function(mu_e / k, q.w, q.h_function) - 1
        backscatter = 1 + np.asarray(q.b_c0) * coherent_backscatter(tan_half, q.h_c)
    r = (
        k
        * np.asarray(q.w)
        / (4 * np.pi)
        * mu0_e
        / np.maximum(mu0_e + mu_e, _TINY)
        * (single + multiple)
        * backscatter
        * shadowing
    )
    result: Array = np.where(lit, np.maximum(r, 0.0), 0.0)
    return result


def brdf(incidence: Numbers, emission: Numbers, azimuth: Numbers, parameters: HapkeParameters) -> Array:
    """Compute the BRDF r / cos(incidence) in 1/sr; 0 where r is 0. It is unchanged when incidence and emission are
    exchanged.
    """
    cosine = np.cos(np.asarray(incidence, np.float64))
    result: Array = bidirectional_reflectance(incidence, emission, azimuth, parameters) / np.maximum(cosine, _TINY)
    return result
