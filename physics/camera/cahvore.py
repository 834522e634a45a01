"""Bending of directions by the lenses of CAHVOR and CAHVORE, and the inverse; ``formats.cahvor`` reads these lenses.

Directions are split into parts along the optical axis ``o`` (3,) and across it. ``r`` (3,) are the radial coefficients,
``e`` (3,) the coefficients of the entrance pupil (None for CAHVOR). ``linearity`` is 1 for perspective and 0 for
fisheye. As in mrcal, the pupil's shift is in units of the distance, so each pixel sees one direction.
"""

from __future__ import annotations

import math

import numpy as np

from ...support.arrays import Array
from .invert_growing import find_smallest_positive_root, invert

#: Maximum number of steps of Newton's method.
_MAX_NEWTON_STEPS = 60
#: A direction is in the field of the lens if bending and unbending it changes it by at most this.
_SAME_DIRECTION = 1e-9


def bend(d: Array, o: Array, r: Array, e: Array | None, linearity: float) -> Array:
    """Bend directions (..., 3) as the lens does."""
    if e is not None:
        d = d / np.linalg.norm(d, axis=-1, keepdims=True)
    zeta = d @ o
    away: Array = d - zeta[..., None] * o
    l2 = (away**2).sum(axis=-1)
    if e is None:
        t = l2 / zeta**2
        return d + (r[0] + t * (r[1] + t * r[2]))[..., None] * away
    length = np.sqrt(l2)
    chi = _chi(_pupil_angle(zeta, length, e), linearity)
    mu = r[0] + chi**2 * (r[1] + chi**2 * r[2])
    along = np.where(chi > 1e-8, length / np.where(chi > 1e-8, chi, 1.0), zeta)
    return along[..., None] * o + (1 + mu)[..., None] * away


def is_seen(d: Array, o: Array, r: Array, e: Array | None, linearity: float) -> Array:
    """Return whether the lens shows directions (..., 3): only those before the fold of its polynomial and not behind
    the lens.
    """
    d = d / np.linalg.norm(d, axis=-1, keepdims=True)
    zeta = d @ o
    length = np.linalg.norm(d - zeta[..., None] * o, axis=-1)
    with np.errstate(all="ignore"):
        if e is None:
            return np.asarray((zeta > 0) & (length <= _find_fold(r) * zeta))
        theta = _pupil_angle(zeta, length, e)
        return np.asarray((theta < _widest(linearity)) & (_chi(theta, linearity) <= _find_fold(r)))


def unbend(d: Array, o: Array, r: Array, e: Array | None, linearity: float) -> Array:
    """Find the unit directions (..., 3) that the lens bends into ``d`` (..., 3); NaN outside its field of view."""
    zeta = d @ o
    away: Array = d - zeta[..., None] * o
    length = np.linalg.norm(away, axis=-1)
    side = np.divide(away, length[..., None], out=np.zeros_like(away), where=length[..., None] > 0)
    with np.errstate(all="ignore"):
        widest = _find_fold(r)
        if e is not None:
            widest = min(widest, float(_chi(np.array(min(_widest(linearity), math.pi)), linearity)))
        # The tangent of the bent direction is a polynomial of the original tangent, or of chi.
        seen = np.where(zeta > 0, length / zeta, np.nan)
        angle = invert(lambda a: _polynomial(np.tan(a), r), seen, math.atan(widest))
        if e is not None:
            chi = np.tan(angle)
            theta = _from_chi(chi, linearity)
            t2 = theta**2
            shift = (theta - np.sin(theta)) * (e[0] + t2 * (e[1] + t2 * e[2]))
            angle = theta - np.arcsin(shift)
        found = np.cos(angle)[..., None] * o + np.sin(angle)[..., None] * side
        again = bend(found, o, r, e, linearity)
        off = np.abs(again / np.linalg.norm(again, axis=-1, keepdims=True) - d / np.hypot(zeta, length)[..., None])
        lost = ~(off.max(axis=-1) < _SAME_DIRECTION) | ~is_seen(found, o, r, e, linearity)
    return np.where(lost[..., None], np.nan, found)


def _polynomial(chi: Array, r: Array) -> Array:
    """Compute the bent tangent of a direction at ``chi``, a polynomial with the radial coefficients ``r``."""
    t = chi**2
    return chi * (1 + r[0] + t * (r[1] + t * r[2]))


def _find_fold(r: Array) -> float:
    """Find the smallest tangent (or chi) at which the polynomial stops growing; infinite if it always grows."""
    return math.sqrt(find_smallest_positive_root([5 * r[2], 3 * r[1], 1 + r[0]]))


def _widest(linearity: float) -> float:
    """Return the largest angle at the pupil, in rad, up to which chi grows."""
    return math.pi / 2 / abs(linearity) if linearity else math.inf


def _pupil_angle(zeta: Array, length: Array, e: Array) -> Array:
    """Find the angles, in rad off the optical axis, at which light enters the moving pupil, by Newton's method."""
    theta = np.arctan2(length, zeta)
    for _ in range(_MAX_NEWTON_STEPS if e.any() else 0):
        sine, cosine, t2 = np.sin(theta), np.cos(theta), theta**2
        shift = e[0] + t2 * (e[1] + t2 * e[2])
        value = zeta * sine - length * cosine - (theta - sine) * shift
        slope = (
            zeta * cosine + length * sine - (1 - cosine) * shift - (theta - sine) * theta * (2 * e[1] + 4 * e[2] * t2)
        )
        step = value / slope
        theta = theta - step
        if np.abs(step).max(initial=0.0) < 1e-15:
            break
    return theta


def _chi(theta: Array, linearity: float) -> Array:
    """Compute chi, the generalised tangent of an angle ``theta`` in rad."""
    if linearity < 0:
        return np.asarray(np.sin(linearity * theta) / linearity)
    return np.asarray(np.tan(linearity * theta) / linearity) if linearity > 0 else theta


def _from_chi(chi: Array, linearity: float) -> Array:
    """Compute the angle in rad that has this chi."""
    if linearity < 0:
        return np.asarray(np.arcsin(linearity * chi) / linearity)
    return np.asarray(np.arctan(linearity * chi) / linearity) if linearity > 0 else chi
