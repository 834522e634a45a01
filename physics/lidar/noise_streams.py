"""The effects of a detector that can be switched, and the random stream of each: one off leaves the others' numbers."""

from __future__ import annotations

from dataclasses import dataclass

#: Child of the seed stream "lidar" of each effect, after the number of the scan; never renumbered.
AMPLITUDE, JITTER, ALARMS, WAVEFORM, ARRIVALS = range(5)


@dataclass(frozen=True)
class Effects:
    """Which effects of a detector are simulated."""

    shot_noise: bool = True  # of signal and background
    amplifier_noise: bool = True
    dark_counts: bool = True
    jitter: bool = True
    walk: bool = True  # of a leading edge with the amplitude
    false_alarms: bool = True
    quantization: bool = True
    saturation: bool = True


#: A detector without noise or faults.
IDEAL = Effects(False, False, False, False, False, False, False, False)
