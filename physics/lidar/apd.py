"""An avalanche photodiode with an amplifier: noise, false alarms, sampled waveforms and their rising edges.

Noise is Gaussian. The gain of a real avalanche has a longer tail (McIntyre's law), by which false alarms at high
thresholds are more frequent than Rice's formula states (Huntington et al. 2018, Optical Engineering 57, 073106).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array, Numbers
from ...support.errors import IcyMoonError
from ..light.photons import BOLTZMANN_J_K
from ..random_numbers.seeds import make_generator
from .noise_streams import WAVEFORM, Effects

ELECTRON_C = 1.602176634e-19  # CODATA 2018, exact


@dataclass(frozen=True)
class Apd:
    """A photodiode and its amplifier: mean gain M, ratio k of the ionisation by holes to the ionisation by electrons,
    quantum efficiency, bandwidth in Hz, dark current before the gain in A, feedback resistance in ohm and its
    temperature in K. Raises IcyMoonError for impossible values.
    """

    gain: float = 100.0
    ionisation_ratio: float = 0.02
    efficiency: float = 0.7
    bandwidth_hz: float = 2e8
    dark_a: float = 5e-11
    load_ohm: float = 1e4
    temperature_k: float = 293.0

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("gain", self.gain, 1.0, 1e6),
            ("ionisation ratio", self.ionisation_ratio, 0.0, 1.0),
            ("quantum efficiency", self.efficiency, 1e-6, 1.0),
            ("bandwidth in Hz", self.bandwidth_hz, 1.0, 1e12),
            ("dark current in A", self.dark_a, 0.0, 1.0),
            ("load in ohm", self.load_ohm, 1e-3, 1e12),
            ("temperature in K", self.temperature_k, 0.0, 1000.0),
        ):
            if not low <= value <= high:
                raise IcyMoonError(f"The {name} of the photodiode is {value:g}; give {low:g} to {high:g}.")

    @property
    def excess_noise(self) -> float:
        """Excess noise factor on shot noise, F = k M + (1 - k)(2 - 1/M): McIntyre 1966, IEEE Trans. Electron Devices
        13, 164.
        """
        return self.ionisation_ratio * self.gain + (1.0 - self.ionisation_ratio) * (2.0 - 1.0 / self.gain)

    def signal_a(self, photons_1_s: Numbers) -> Array:
        """Compute the current in A, after the gain, from photons per second."""
        return np.asarray(ELECTRON_C * self.gain * self.efficiency * np.asarray(photons_1_s, np.float64))

    def noise_a(self, photons_1_s: Numbers, effects: Effects = Effects()) -> Array:  # noqa: B008
        """Compute the standard deviation σ of the current in A at a rate of photons that includes the background.

        The law is σ² = 2 q M² F B (I + I_dark) + 4 k T B / R.
        """
        rate = np.asarray(photons_1_s, np.float64)
        primary = ELECTRON_C * self.efficiency * rate * effects.shot_noise + self.dark_a * effects.dark_counts
        shot = 2.0 * ELECTRON_C * self.gain**2 * self.excess_noise * self.bandwidth_hz * primary
        thermal = 4.0 * BOLTZMANN_J_K * self.temperature_k * self.bandwidth_hz / self.load_ohm
        return np.asarray(np.sqrt(shot + thermal * effects.amplifier_noise))


def false_alarm_rate_hz(threshold_over_noise: Numbers, bandwidth_hz: float) -> Array:
    """Compute the rate in Hz at which noise crosses a threshold upward: B/√3 exp(-(T/σ)²/2).

    Source: Rice 1944, for noise of even power below the bandwidth B.
    """
    over = np.asarray(threshold_over_noise, np.float64)
    return np.asarray(bandwidth_hz / math.sqrt(3.0) * np.exp(-(over**2) / 2.0))


def threshold_over_noise(rate_hz: float, bandwidth_hz: float) -> float:
    """Compute the threshold, in standard deviations of the noise, that gives a rate of false alarms in Hz; 0 above
    Rice's largest rate. Raises IcyMoonError for a rate of 0 or less.
    """
    if not rate_hz > 0.0:
        raise IcyMoonError(f"The rate of false alarms is {rate_hz:g} Hz; give more than 0 Hz.")
    return math.sqrt(2.0 * max(math.log(bandwidth_hz / math.sqrt(3.0) / rate_hz), 0.0))


def draw_waveforms(
    apd: Apd,
    photons_1_s: Array,
    sample_s: float,
    seed: int,
    scan: int = 0,
    effects: Effects = Effects(),  # noqa: B008
) -> Array:
    """Draw the currents in A (beams, samples) of light (beams, samples) in photons per second, with noise of even power
    below the bandwidth. The same seed and scan give the same bits. Raises IcyMoonError if samples are too far apart for
    the bandwidth.
    """
    rate = np.atleast_2d(np.asarray(photons_1_s, np.float64))
    if not 0.0 < sample_s <= 0.5 / apd.bandwidth_hz:
        raise IcyMoonError(
            f"Samples are {sample_s:g} s apart for a bandwidth of {apd.bandwidth_hz:g} Hz; "
            f"give more than 0 and at most {0.5 / apd.bandwidth_hz:g} s."
        )
    signal, deviation = apd.signal_a(rate), apd.noise_a(rate, effects)
    if not deviation.any():
        return signal
    white = make_generator(seed, "lidar", scan, WAVEFORM).standard_normal(rate.shape)
    spectrum = np.fft.rfft(white, axis=1)
    kept = np.fft.rfftfreq(rate.shape[1], sample_s) <= apd.bandwidth_hz
    # The cut has reduced the variance to the kept share of the band; divide by its root.
    share = (2.0 * kept.sum() - 1.0) / rate.shape[1]
    noise = np.fft.irfft(spectrum * kept, rate.shape[1], axis=1) / math.sqrt(min(share, 1.0))
    return np.asarray(signal + deviation * noise)


def digitise(current_a: Array, full_scale_a: float, bits: int) -> Array:
    """Convert currents in A to the output of a converter of ``bits``, in A: from 0 to its full scale, rounded,
    saturated. Raises IcyMoonError for an impossible converter.
    """
    if not full_scale_a > 0.0 or not 1 <= bits <= 32:
        raise IcyMoonError(f"The converter has {bits} bits to {full_scale_a:g} A; give 1 to 32 bits and more than 0 A.")
    step = full_scale_a / (2**bits - 1)
    return np.asarray(np.clip(np.rint(current_a / step), 0, 2**bits - 1) * step)


def find_edges(current_a: Array, threshold_a: float, sample_s: float, dead_s: float = 0.0) -> tuple[Array, Array]:
    """Find the beams (k,) and times (k,) in s at which currents (beams, samples) rise through a threshold, sorted by
    beam and time. Currents between samples are interpolated linearly. After each edge the comparator is dead for
    ``dead_s``.
    """
    below, above = current_a[:, :-1], current_a[:, 1:]
    beam, sample = np.nonzero((below < threshold_a) & (above >= threshold_a))
    low, high = below[beam, sample], above[beam, sample]
    time = (sample + (threshold_a - low) / (high - low)) * sample_s
    if dead_s <= 0.0 or not len(time):
        return beam, time
    kept = np.zeros(len(time), bool)
    last_beam, free = -1, 0.0
    for k, (one, at) in enumerate(zip(beam.tolist(), time.tolist(), strict=True)):
        if one != last_beam or at >= free:
            kept[k], last_beam, free = True, one, at + dead_s
    return beam[kept], time[kept]
