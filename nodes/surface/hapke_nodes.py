"""Hapke's reflectance as nodes, which work in every Blender and on every device.

The formula comes from ``physics/surfaces/hapke.py``. Terms that the parameters switch off get no nodes: a smooth
surface without surges has about 50 nodes, a rough one with both surges about 130.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..tree.formula import Number, Vector

NAME = "Hapke's BRDF"  # label of the last node


@dataclass(frozen=True)
class Grains:
    """The parameters of ``hapke.osl``. Nodes may give w and tan_theta; the others are constants."""

    w: Number
    tan_theta: Number
    b: float
    c: float
    b_s0: float
    h_s: float
    b_c0: float
    h_c: float
    k: float
    h_function: str


def add_brdf(n: Vector, l: Vector, v: Vector, blur: Number, q: Grains) -> Number:  # noqa: E741
    """Add the BRDF, in 1/sr: the radiance divided by the irradiance on the surface.

    n, l and v are unit vectors, with l on the side of n. If a shading normal n points away from v although the facet is
    visible, the result is for a grazing view. ``blur`` is the mean distance of points on the source's disc from its
    centre, as the tangent of half the angle.
    """
    mu0, mu = n.dot(l).at_least(1e-6).named("µ0"), n.dot(v).at_least(1e-6).named("µ")
    single = backscatter = Number(n.tree, 1.0)
    if q.b != 0.0 or _has_surges(q):
        near, far = l.distance(v).named("|l - v|"), (l + v).length().named("|l + v|")
        single = _add_phase_function(near, far, q)
    if _has_surges(q):
        t = near / far.at_least(1e-15)
        t = t.times_plus(t, blur * blur).sqrt().named("tan g/2, blurred")
        if q.b_s0 * q.h_s > 0.0:
            single = single * (q.h_s / (t + q.h_s)).times_plus(q.b_s0, 1.0).named("1 + BS0 BS")
        if q.b_c0 * q.h_c > 0.0:
            backscatter = _add_coherent_backscatter(t, q.h_c).times_plus(q.b_c0, 1.0).named("1 + BC0 BC")
    # A BRDF is symmetric in Sun and observer: 'n' is the ray nearer to the normal, 'f' the farther one.
    mu_n, mu_f = mu0.at_least(mu), mu0.at_most(mu)
    scale, shadowing = Number(n.tree, 1.0 / q.k), Number(n.tree, 1.0)
    if q.tan_theta.known != 0.0:
        mu_n, mu_f, shadowing = _add_roughness(n, l, v, mu_n, mu_f, q.tan_theta)
        scale = scale / (q.tan_theta * q.tan_theta).times_plus(math.pi, 1.0).sqrt()
    h = _add_h_function(mu_n * scale, q).named("H") * _add_h_function(mu_f * scale, q).named("H")
    total = (single + h - 1.0).named("p(1 + BS0 BS) + HH - 1")
    return (total * backscatter * (shadowing / (mu_n + mu_f)) * (q.w * (q.k / (4 * math.pi)))).named(NAME)


def _has_surges(q: Grains) -> bool:
    return q.b_s0 * q.h_s > 0.0 or q.b_c0 * q.h_c > 0.0


def _add_phase_function(near: Number, far: Number, q: Grains) -> Number:
    if q.b == 0.0:
        return Number(near.tree, 1.0)
    total = Number(near.tree, 0.0)
    # For b < 0 the lobes are exchanged, which keeps the sums positive.
    toward, away = (near, far) if q.b > 0 else (far, near)
    for distance, weight in ((toward, (1 + q.c) / 2), (away, (1 - q.c) / 2)):
        if weight:
            spread = (distance * distance).times_plus(abs(q.b), (1 - abs(q.b)) ** 2)
            total = spread.power(-1.5).times_plus(weight * (1 - q.b * q.b), total)
    return total.named("p")


def _add_coherent_backscatter(t: Number, h_c: float) -> Number:
    x = (t / h_c).at_most(1e6).named("x")
    # For small x, a series replaces the difference of nearly equal numbers, which would lose digits.
    small = -x.at_most(0.1)
    series = small.times_plus(1 / 24, 1 / 6).times_plus(small, 0.5).times_plus(small, 1.0)
    exact = (1.0 - (-x).exp()) / x.at_least(1e-3)
    ratio = (exact - series).times_plus(x.exceeds(0.1), series).named("(1 - e^-x)/x")
    return (ratio + 1.0) * 0.5 / ((x + 1.0) * (x + 1.0))


def _add_h_function(x: Number, q: Grains) -> Number:
    gamma = (1.0 - q.w).at_least(0.0).sqrt()
    if q.h_function == "1981":
        return x.times_plus(2.0, 1.0) / x.times_plus(gamma * 2.0, 1.0)
    r0 = (1.0 - gamma) / (gamma + 1.0)
    x = x.at_least(1e-6)
    logarithm = (1.0 / x + 1.0).log()
    if q.h_function == "1993":
        bracket = x.times_plus(-r0, 1.0 - r0 * 0.5).times_plus(logarithm, r0)
        return 1.0 / (x * (1.0 - gamma)).times_plus(-bracket, 1.0)
    bracket = x.times_plus(-r0, 0.5).times_plus(logarithm, r0)
    return 1.0 / (x * q.w).times_plus(-bracket, 1.0)


def _add_roughness(
    n: Vector,
    l: Vector,  # noqa: E741
    v: Vector,
    mu_n: Number,
    mu_f: Number,
    tan_theta: Number,
) -> tuple[Number, Number, Number]:
    """Add both effective cosines without their common factor χ, and S mu_n mu_f / (µ0 χ)."""
    l_t, v_t = l.cross(n), v.cross(n)
    p, s = l_t.unit(), v_t.unit()
    apart, together = p.distance(s), (p + s).length().at_least(1e-7)
    tan_psi = (apart / together).named("tan ψ/2")
    square = tan_psi * tan_psi
    side = (square / (square + 1.0)).named("sin² ψ/2")
    turned = (apart.arctan2(together) * (2 / math.pi)).named("ψ/π")
    f = (tan_psi * -2.0).exp().named("f")
    sin_l, sin_v = l_t.length(), v_t.length()

    def terms(mu: Number, sin: Number) -> tuple[Number, Number, Number, Number]:
        tilt = (sin * tan_theta).named("sin tan θ")
        slope = (mu / (sin.at_least(1e-7) * tan_theta.at_least(1e-5))).at_most(1e4).named("cot cot θ")
        e1, e2 = (slope * (-2 / math.pi)).exp().named("E1"), (slope * slope * (-1 / math.pi)).exp().named("E2")
        return tilt, 2.0 - e1, e2, (tilt * e2 / (2.0 - e1) + mu).named("η/χ")

    tilt_n, less_n, e2_n, eta_n = terms(mu_n, sin_l.at_most(sin_v))
    tilt_f, less_f, e2_f, eta_f = terms(mu_f, sin_l.at_least(sin_v))
    # less_n is 2 - E1, so E1 of the nearer ray is 2 - less_n.
    whole = ((less_n - 2.0).times_plus(turned, less_f)).at_least(1e-7).named("2 - E1 - ψ/π E1")
    rough_n = ((e2_f.times_plus(-2.0, e2_n).times_plus(side, e2_f) * tilt_n) / whole + mu_n).at_least(0.0)
    rough_f = ((e2_f - side * e2_n) * tilt_f / whole + mu_f).at_least(1e-12)
    bright = 1.0 - f * (1.0 - mu_n / eta_n)
    shadowing = (rough_n * rough_f) / (eta_n * eta_f * bright)
    return rough_n.named("µ nearer/χ"), rough_f.named("µ farther/χ"), shadowing.named("S")
