"""What was varied: the points that noise of the render decides are marked."""

import cv2
import numpy as np
import pytest
from icymoon.stereo.report import charts, sweep_charts
from icymoon.stereo.report.by_setting import VariedSetting, find_noisy_levels
from icymoon.stereo.report.summary import ResultTable

PAIRS = [f"p{k}" for k in range(6)]
SWEEP = VariedSetting("light.sun_elevation_deg", "Sun", np.array([8.0, 8.0, 20.0, 20.0, 45.0, np.nan]))


@pytest.mark.parametrize(
    ("noisy", "levels"),
    [
        ([], [False, False, False]),
        ([0, 1], [True, False, False]),
        ([0, 2, 3], [True, True, False]),
        ([5], [False, False, False]),
    ],
)
def test_a_point_is_marked_if_noise_decides_half_of_its_pairs(noisy, levels):
    table = ResultTable(["bm"], PAIRS)
    table.by_noise[noisy] = True
    np.testing.assert_array_equal(find_noisy_levels(SWEEP, table), levels)


@pytest.mark.parametrize("noisy", [False, True])
def test_the_chart_has_a_band_with_its_meaning(noisy, monkeypatch):
    table = ResultTable(["bm"], PAIRS)
    table.by_noise[0] = noisy
    with charts.matplotlib.rc_context(charts.STYLE):
        _, axes = charts.make_figure(2)
        # No intervals: what they are made of is not what this is about.
        monkeypatch.setattr(sweep_charts, "average_by_level", lambda *_: (np.ones(3), np.full((3, 2), np.nan)))
        for axis, drawn in zip(axes[0], sweep_charts.SWEPT_METRICS, strict=True):
            sweep_charts._draw_sweep(SWEEP, axis, drawn, [{"method": "bm"}], table)
    for axis in axes[0]:
        assert len(axis.patches) == noisy
        assert ("noise of the render decides" in axis.get_xlabel()) == noisy
        if noisy:
            band = axis.patches[0].get_extents().transformed(axis.transData.inverted())
            assert band.x0 < 8 < band.x1 < 20


def test_the_band_of_a_picture_is_light(monkeypatch, tmp_path):
    table = ResultTable(["bm"], PAIRS)
    table.by_noise[0] = True
    monkeypatch.setattr(sweep_charts, "average_by_level", lambda *_: (np.ones(3), np.full((3, 2), np.nan)))
    written = sweep_charts.write_curves([{"method": "bm"}], table, [SWEEP], tmp_path)
    grey = cv2.imread(str(tmp_path / written[SWEEP.name]), cv2.IMREAD_GRAYSCALE)
    values = np.bincount(grey.ravel(), minlength=256)
    assert values[:200].max() < 0.02 * grey.size  # letters and lines, no area
    assert values[200:250].max() > 0.02 * grey.size  # the band
