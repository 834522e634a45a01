"""Phase curves of an evaluation's surfaces, against the closed form of Lambert's sphere."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import load_preset
from icymoon.stereo.report.charts import draw_charts
from icymoon.stereo.report.phase_curves import MAX_LAWS, PHASE_DEG, compute_phase_curves


def facts(*parts: dict) -> dict:
    return {"settings": merged(defaults(), *parts)}


def test_principled_snow_has_no_curve():
    assert compute_phase_curves([facts()]) == {}


def test_lamberts_sphere_is_as_in_closed_form():
    (bright,) = compute_phase_curves([facts({"surface": {"model": "LAMBERT"}})]).values()
    a = np.radians(PHASE_DEG)
    # The quadrature's nodes leave a few parts in a thousand where the crescent is thin.
    assert bright == pytest.approx((np.sin(a) + (np.pi - a) * np.cos(a)) / np.pi, abs=2e-3)


def test_each_law_is_drawn_once_and_that_of_rocks_with_their_own_surface_too():
    hapke = load_preset("surfaces/hapke_europa_bright_plains")
    found = compute_phase_curves(
        [
            facts(hapke),
            facts(hapke),
            facts(
                hapke, {"rocks": {"coverage": 0.1, "own_surface": True}, "rock_surface": {"model": "LOMMEL_SEELIGER"}}
            ),
        ]
    )
    assert [name.split()[0] for name in found] == ["Hapke", "Lommel-Seeliger"]
    surge = next(iter(found.values()))
    assert surge[0] == 1.0
    assert np.all(np.diff(surge) < 0)
    # Within a degree the opposition surge takes more than the sphere's shape does.
    assert surge[np.searchsorted(PHASE_DEG, 1.0)] < 0.99
    many = compute_phase_curves(
        [facts({"surface": {"model": "LUNAR_LAMBERT", "lommel_seeliger_share": k / 10}}) for k in range(9)]
    )
    assert len(many) == MAX_LAWS


def test_the_report_has_the_plot_only_where_there_is_a_law():
    near, whole = draw_charts([], None, {"Lambert": np.ones_like(PHASE_DEG)}, [])["phase"]
    assert near.startswith("<svg")
    assert "Lambert" in whole
    assert not any(draw_charts([], None, {}, []).values())
