"""Ranges as a detector with a threshold measures them, return by return, without a waveform.

A return of N photo-electrons is a Gaussian pulse. It is detected if its noisy peak passes the threshold. A comparator
stops where the rising edge passes the threshold: earlier on a stronger pulse (walk), with a jitter of noise over slope.
Timing by the centroid of photons has no walk and the jitter σ/√N. False alarms before the return follow Rice's rate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array, Numbers
from ...support.errors import IcyMoonError
from ..light.photons import LIGHT_M_S
from ..random_numbers.seeds import make_generator
from .apd import false_alarm_rate_hz
from .noise_streams import ALARMS, AMPLITUDE, JITTER, Effects

_FWHM = 2.0 * math.sqrt(2.0 * math.log(2.0))


@dataclass(frozen=True)
class Detector:
    """A detector by its figures.

    ``noise_electrons`` is the noise without signal, as photo-electrons in a pulse, and ``excess_noise`` the factor F on
    shot noise. A pulse of ``threshold_electrons`` has its peak at the threshold. ``timing`` is EDGE or CENTROID.
    ``jitter_s`` is added to the jitter of noise. ``resolution_m`` is the step of the range (0: no steps), and
    ``saturation`` the largest intensity in electrons. ``bandwidth_hz`` is the B of Rice's rate (0: 0.44 over the
    pulse's length), and ``gate_m`` are the nearest and the farthest range. Raises IcyMoonError for impossible values.
    """

    pulse_fwhm_s: float = 1e-9
    threshold_electrons: float = 50.0
    noise_electrons: float = 8.0
    excess_noise: float = 1.0
    timing: str = "EDGE"
    jitter_s: float = 0.0
    resolution_m: float = 0.0
    saturation: float = math.inf
    bandwidth_hz: float = 0.0
    gate_m: tuple[float, float] = (0.0, 10_000.0)

    def __post_init__(self) -> None:
        if not 0.0 < self.pulse_fwhm_s < math.inf:
            raise IcyMoonError(f"The pulse is {self.pulse_fwhm_s:g} s long; give more than 0 s.")
        if not self.threshold_electrons > 0.0:
            raise IcyMoonError(f"The threshold is {self.threshold_electrons:g} electrons; give more than 0.")
        if self.timing not in ("EDGE", "CENTROID"):
            raise IcyMoonError(f"The timing {self.timing} is unknown; give EDGE or CENTROID.")
        if not 0.0 <= self.gate_m[0] < self.gate_m[1] < math.inf:
            raise IcyMoonError(f"The gate is {self.gate_m[0]:g} to {self.gate_m[1]:g} m; give two increasing ranges.")
        for name in ("noise_electrons", "jitter_s", "resolution_m", "bandwidth_hz"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise IcyMoonError(f"The detector's {name} is {getattr(self, name):g}; give 0 or more.")
        if not self.excess_noise >= 1.0 or not self.saturation > 0.0:
            raise IcyMoonError(
                "The excess noise is below 1 or the saturation is 0; give a noise from 1 on and a saturation above 0."
            )

    @property
    def deviation_s(self) -> float:
        """Standard deviation of the pulse in s."""
        return self.pulse_fwhm_s / _FWHM

    @property
    def rice_hz(self) -> float:
        """Bandwidth of Rice's formula in Hz."""
        return self.bandwidth_hz or 0.44 / self.pulse_fwhm_s


@dataclass(frozen=True)
class Detections:
    """Measurements (n,) of returns: range in metres (NaN without a detection), intensity in electrons, and whether the
    detection is a false alarm.
    """

    range_m: Array
    electrons: Array
    is_false: Array


def edge_walk_s(deviation_s: float, amplitude_over_threshold: Numbers) -> Array:
    """Compute the time in s from a threshold on the rising edge of a Gaussian pulse to its peak: σ √(2 ln(A/T)); 0 if
    the peak is below the threshold.
    """
    over = np.maximum(np.asarray(amplitude_over_threshold, np.float64), 1.0)
    return np.asarray(deviation_s * np.sqrt(2.0 * np.log(over)))


def correct_walk_m(found: Detections, detector: Detector) -> Array:
    """Remove the walk of the measured intensity from leading-edge ranges (n,), in metres, as a calibrated instrument
    does. Where the intensity saturates, the rest of the walk stays.
    """
    over = np.where(found.is_false, 1.0, found.electrons / detector.threshold_electrons)
    return np.asarray(found.range_m + LIGHT_M_S / 2.0 * edge_walk_s(detector.deviation_s, over))


def edge_jitter_s(deviation_s: float, amplitude_over_threshold: Numbers, threshold_over_noise: Numbers) -> Array:
    """Compute the jitter in s of a threshold on the rising edge, noise over slope: σ / ((T/σn) √(2 ln(A/T))), at most
    the pulse's σ.

    At half of the peak the jitter is 1.70 σ over the signal-to-noise ratio, about the rise time (10 to 90 %: 1.69 σ)
    over that ratio.
    """
    over = np.asarray(amplitude_over_threshold, np.float64)
    steep = np.asarray(threshold_over_noise, np.float64) * np.sqrt(2.0 * np.log(np.maximum(over, 1.0)))
    return np.asarray(deviation_s / np.maximum(steep, 1.0))


def photon_jitter_m(deviation_s: float, photons: Numbers) -> Array:
    """Compute the least standard deviation in metres of a range from N photons of a pulse: c σ / (2 √N)."""
    return np.asarray(LIGHT_M_S / 2.0 * deviation_s / np.sqrt(np.maximum(np.asarray(photons, np.float64), 1.0)))


def detect_returns(
    range_m: Array,
    electrons: Numbers,
    detector: Detector,
    seed: int,
    scan: int = 0,
    background_electrons: Numbers = 0.0,
    effects: Effects = Effects(),  # noqa: B008
) -> Detections:
    """Measure the first return (n,) of beams at true ranges in metres, NaN or infinite without a target.

    ``electrons`` are expected from the pulse, and ``background_electrons`` from sunlight and dark current in the length
    of a pulse. The same seed and scan give the same bits. Each effect has its own random stream, so that switching one
    off changes no other.
    """
    true, expected = np.broadcast_arrays(np.asarray(range_m, np.float64), np.asarray(electrons, np.float64))
    if not (expected >= 0.0).all():
        raise IcyMoonError("The electrons of a return are negative or unknown; give 0 or more.")
    base = find_noise(detector, np.asarray(background_electrons, np.float64), effects)
    there = np.isfinite(true) & (true >= detector.gate_m[0]) & (true <= detector.gate_m[1])
    light = np.where(there, expected, 0.0)
    noise = np.sqrt(base**2 + detector.excess_noise * light * effects.shot_noise)
    amplitude = light + noise * make_generator(seed, "lidar", scan, AMPLITUDE).standard_normal(true.shape)
    seen = there & (amplitude >= detector.threshold_electrons)
    measured = np.where(seen, true, np.nan)
    drawn = make_generator(seed, "lidar", scan, JITTER).standard_normal(true.shape) if effects.jitter else 0.0
    measured += LIGHT_M_S / 2.0 * time_return(detector, light, amplitude, noise, drawn, effects)
    is_false = np.zeros(true.shape, bool)
    if effects.false_alarms:
        measured, is_false = _raise_alarms(detector, measured, base, seed, scan)
    amplitude = np.where(is_false, detector.threshold_electrons, amplitude)
    if effects.quantization:
        measured = quantize(measured, detector.resolution_m)
    most = detector.saturation if effects.saturation else math.inf
    shown = np.where(np.isnan(measured), 0.0, np.clip(amplitude, 0.0, most))
    return Detections(measured, shown, is_false)


def find_noise(detector: Detector, background: Array, effects: Effects) -> Array:
    """Compute the noise without signal, in electrons of a pulse; ``background`` is the electrons of steady light in a
    pulse.
    """
    steady = detector.noise_electrons**2 * effects.amplifier_noise
    return np.sqrt(steady + detector.excess_noise * np.maximum(background, 0.0) * effects.shot_noise)


def time_return(
    detector: Detector,
    light: Array,
    amplitude: Array,
    noise: Array,
    drawn: Numbers,
    effects: Effects,
    deviation_s: Numbers | None = None,
) -> Array:
    """Compute the error (n,) in s of the time of returns: walk, jitter of noise, and the detector's own jitter.

    ``light`` and ``amplitude`` (n,) are the expected and the noisy electrons, and ``noise`` (n,) their deviation.
    ``drawn`` are normal variates (0: no jitter), and ``deviation_s`` is the deviation of the pulses (None: the
    detector's own).
    """
    shot = detector.excess_noise * effects.shot_noise
    sigma = detector.deviation_s if deviation_s is None else np.asarray(deviation_s)
    error = np.zeros(light.shape)
    if detector.timing == "EDGE":
        over = amplitude / detector.threshold_electrons
        if effects.walk:
            error -= sigma * edge_walk_s(1.0, over)
        # The edge crosses where the light is at the threshold, so the noise belongs to that light; the peak is later.
        steady = np.maximum(noise**2 - shot * light, 0.0)
        least = np.minimum(light, detector.threshold_electrons)
        edge_noise = np.sqrt(steady + shot * least)
        spread = sigma * edge_jitter_s(1.0, over, detector.threshold_electrons / np.maximum(edge_noise, 1e-30))
    else:
        # σ √(F N + n²) / N is the photon limit with excess noise, background and amplifier.
        spread = sigma * noise / np.maximum(light, 1.0)
    return error + np.hypot(spread, detector.jitter_s) * drawn


def quantize(range_m: Array, step_m: float) -> Array:
    """Round ranges to whole steps; a step of 0 leaves them unchanged."""
    return np.rint(range_m / step_m) * step_m if step_m > 0.0 else range_m


def _raise_alarms(detector: Detector, measured: Array, noise: Array, seed: int, scan: int) -> tuple[Array, Array]:
    """Return ranges, and whether each is false: the first alarm of noise before the return, or in the gate without a
    return.
    """
    over = detector.threshold_electrons / np.maximum(noise, 1e-30)
    rate = np.broadcast_to(false_alarm_rate_hz(over, detector.rice_hz) * 2.0 / LIGHT_M_S, measured.shape)
    waited = make_generator(seed, "lidar", scan, ALARMS).standard_exponential(measured.shape)
    at = detector.gate_m[0] + waited / np.maximum(rate, 1e-300)
    is_false = at < np.where(np.isnan(measured), detector.gate_m[1], measured)
    return np.where(is_false, at, measured), is_false
