"""Scans of real ground beside the presets, by a stand-in whose statistics are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.commands.cli import main
from icymoon.support.errors import IcyMoonError
from icymoon.validation.comparison import FAILS, NOT_JUDGED, PASSES
from icymoon.validation.frost import SPACING_M, Statistic, compare_scan, measure_statistics, read_scan

HURST, STEP_M = 0.7, 0.01


def _ground(hurst, slope_deg, seed=1):
    """Heights (500, 500) of 5 m by spectral synthesis: half of a periodic ground, so opposite edges differ.

    The power falls with the wave number to the power of -(2 + 2 H). The slope is between points 0.5 m apart.
    """
    n = 1024
    k = np.hypot(np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n)[None, :])
    k[0, 0] = np.inf
    random = np.random.default_rng(seed)
    noise = random.standard_normal((2, *k.shape))
    heights = np.fft.irfft2((noise[0] + 1j * noise[1]) * k ** -(1 + hurst), (n, n))[:500, :500]
    return heights * (0.5 * math.tan(math.radians(slope_deg)) / _rise(heights, 50))


def _rise(heights, lag):
    """RMS difference of heights that are so many points apart, along both axes."""
    squares = [np.mean((heights[:, lag:] - heights[:, :-lag]) ** 2), np.mean((heights[lag:] - heights[:-lag]) ** 2)]
    return math.sqrt(sum(squares) / 2)


def _write(path, heights, step=STEP_M, kept=slice(None), scale=1.0):
    y, x = np.indices(heights.shape) * step
    points = np.stack([x + 431.0, y - 77.0, heights], axis=-1).reshape(-1, 3)[kept] * scale
    if path.suffix == ".obj":
        path.write_text("\n".join(f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in points), encoding="ascii")
        return path
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property double {name}\n" for name in "xyz") + "end_header\n"
    path.write_bytes(head.encode() + points.astype("<f8").tobytes())
    return path


def _exponent_of_the_spectrum(hurst, points):
    """The exponent from 0.06 to 0.6 m that the spectrum of ``_ground`` gives means over squares of so many points.

    nu² at a lag is the sum of the power times 2 - 2 cos(k lag), and a mean over a cell multiplies the power by the
    square of its Dirichlet kernel.
    """
    n, lags = 1024, np.arange(6, 61, 2)
    down, across = np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n)[None, :]
    k = np.hypot(down, across)
    k[0, 0] = np.inf
    power = k ** -(2 + 2 * hurst) * np.where((across == 0) | (across == 0.5), 1, 2)
    for axis in (down, across):
        with np.errstate(invalid="ignore"):
            kernel = np.sin(np.pi * points * axis) / (points * np.sin(np.pi * axis))
        power = power * np.where(axis == 0, 1, kernel) ** 2
    squares = [np.sum(power * (2 - np.cos(2 * np.pi * lag * down) - np.cos(2 * np.pi * lag * across))) for lag in lags]
    weights = 1 / np.sqrt(lags)  # lags that are even in the logarithm, as the command's
    return np.polyfit(np.log(lags), np.log(squares), 1, w=weights)[0] / 2


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize(("hurst", "shift"), [(0.5, 0.0), (0.7, -0.06), (0.9, -0.13)])
def test_the_exponent_of_a_stand_in_is_off_by_what_the_manual_states(tmp_path, hurst, shift):
    """Against the spectrum that the ground was made of. One patch has a standard deviation of 0.024 to 0.028, and the
    mean of three of 0.016; the plane takes up to 0.03. So 0.05 is 3 deviations behind the mean of the plane's."""
    name = "Hurst exponent from 0.06 to 0.6 m"
    paths = [_write(tmp_path / f"{seed}.ply", _ground(hurst, 10.0, seed)) for seed in range(3)]
    found = np.mean([measure_statistics(read_scan(path))[name].value for path in paths])
    assert found + 0.015 == pytest.approx(_exponent_of_the_spectrum(hurst, 2), abs=0.05)
    assert found - hurst == pytest.approx(shift, abs=0.05)
    # Means over cells make the ground smoother at short distances, most where it is rough.
    raised = _exponent_of_the_spectrum(hurst, 2) - _exponent_of_the_spectrum(hurst, 1)
    assert 0.003 < raised < 0.025


def test_a_scan_of_known_ground_has_its_statistics(tmp_path):
    heights = _ground(HURST, 10.0)
    found = measure_statistics(read_scan(_write(tmp_path / "scan.ply", heights)))
    # Half of a periodic ground lacks long waves, so its exponent is a little below the one of its spectrum.
    lags = [6, 10, 16, 25, 40, 60]
    own = np.polyfit(np.log(lags), np.log([_rise(heights, lag) for lag in lags]), 1)[0]
    assert own == pytest.approx(HURST, abs=0.09)
    # The plane that is taken away, and cells of 2 cm, change its numbers by a few parts in a hundred.
    assert found["Hurst exponent from 0.06 to 0.6 m"].value == pytest.approx(own, abs=0.03)
    assert found["slope"].value == pytest.approx(10.0, rel=0.05)
    nearer = math.degrees(math.atan(_rise(heights, 10) / 0.1))
    assert found["RMS slope at 0.1 m"].value == pytest.approx(nearer, rel=0.05)
    rougher = measure_statistics(read_scan(_write(tmp_path / "rough.ply", 2 * heights)))
    ratio = (
        rougher["logarithm of the power spectrum at 0.2 m"].value
        - found["logarithm of the power spectrum at 0.2 m"].value
    )
    assert ratio == pytest.approx(math.log10(4))
    assert rougher["RMS height"].value == pytest.approx(2 * found["RMS height"].value)


def test_points_lie_where_they_are(tmp_path):
    """A slope of 1 in 5 to the east with a step to the north: rows go north, columns east."""
    east, north = (np.indices((500, 500)) * STEP_M)[::-1]
    heights = read_scan(_write(tmp_path / "scan.ply", 0.2 * east + (north > 2.5)))
    assert heights.shape == (249, 249)
    assert np.diff(heights, axis=1) == pytest.approx(0.2 * SPACING_M, abs=1e-9)
    assert heights[-1].mean() - heights[0].mean() == pytest.approx(1.0)


def test_one_number_chooses_a_preset_and_the_others_judge_it(tmp_path, monkeypatch):
    near = {"slope": 10.0, "RMS slope at 0.1 m": 15.0, "Hurst exponent from 0.06 to 0.6 m": 0.2}
    monkeypatch.setattr("icymoon.validation.frost.preset_names", lambda kind: ["terrains/flat", "terrains/right"])
    presets = {
        "terrains/flat": {name: Statistic(0.0, 0.0) for name in near},
        "terrains/right": {name: Statistic(value, 0.3) for name, value in near.items()},
    }
    monkeypatch.setattr("icymoon.validation.frost.measure_preset", presets.__getitem__)
    theirs = {"slope": Statistic(10.1, 0.4), "RMS slope at 0.1 m": Statistic(16.0, 0.4)}
    theirs["Hurst exponent from 0.06 to 0.6 m"] = Statistic(2.0, 0.4)
    monkeypatch.setattr("icymoon.validation.frost.measure_statistics", lambda heights: theirs)
    monkeypatch.setattr("icymoon.validation.frost.read_scan", lambda path: None)
    chosen, slope, hurst = compare_scan(tmp_path / "salt.ply")
    assert all(row.quantity.startswith("salt and `right`") for row in (chosen, slope, hurst))
    assert slope.allowed == pytest.approx(2.45 * 0.5)  # of both errors, at right angles
    assert (chosen.verdict, slope.verdict, hurst.verdict) == (NOT_JUDGED, PASSES, FAILS)


def test_holes_are_filled_from_their_neighbours_and_too_many_are_refused(tmp_path):
    heights = _ground(HURST, 10.0)
    full = read_scan(_write(tmp_path / "full.ply", heights))
    kept = np.ones(heights.shape, bool)
    kept[200:240, 200:240] = False  # 400 of 62,000 cells
    holed = read_scan(_write(tmp_path / "holed.ply", heights, kept=kept.ravel()))
    assert np.isfinite(holed).all()
    same = np.ones(full.shape, bool)
    same[99:121, 99:121] = False
    assert np.array_equal(holed[same], full[same])
    kept[:, :200] = False
    kept[:2] = True  # so that the sides are the same
    with pytest.raises(IcyMoonError, match=r"of the cells of 2 cm have no point, 5% are allowed"):
        read_scan(_write(tmp_path / "half.ply", heights, kept=kept.ravel()))


@pytest.mark.long
def test_an_obj_file_is_read_too(tmp_path):
    heights = _ground(HURST, 10.0)
    one, other = (read_scan(_write(tmp_path / f"scan{end}", heights)) for end in (".ply", ".obj"))
    assert one == pytest.approx(other, abs=1e-4)


def test_a_scan_that_is_not_in_metres_is_refused(tmp_path):
    path = _write(tmp_path / "scan.ply", np.zeros((100, 100)), 0.05, scale=1000.0)
    with pytest.raises(IcyMoonError, match="in metres with z up"):
        read_scan(path)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ([], "pass --frost FOLDER"),
        (["--frost", "nowhere"], "nowhere is not a folder"),
        (["--frost", __file__], "is not a folder"),
        (["--frost", "docs"], "has no scan"),
    ],
)
def test_the_command_without_scans_names_where_they_are(tmp_path, monkeypatch, capsys, options, word):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs").mkdir()
    assert main(["validate", "--only", "frost", "--out", str(tmp_path), *options]) == 1
    printed = " ".join(capsys.readouterr().out.split())
    assert word in printed
    assert "ti.arc.nasa.gov/dataset/frost" in printed
