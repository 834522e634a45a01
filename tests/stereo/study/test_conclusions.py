"""What is concluded from views whose numbers are known."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from icymoon.stereo.study.conclusions import FAILS, HOLDS, OPEN, draw_conclusions
from icymoon.stereo.study.design import CONVERGED, Hypothesis, find_study, read_study
from icymoon.stereo.study.view_measurements import Cell

METHODS = ["bm", "sgbm"]
PIXELS = 10_000
STUDY = read_study(find_study("recipes"))


def cell(ground, errors, noise=None, quiet=0.001, sun=20.0, shadow=0.3):
    """A view of a ground with these errors, in % and alike in light and shadow, by recipe and method."""
    dark = round(PIXELS * shadow)
    tallies = {
        recipe: {
            method: np.array([[n, round(n * error / 100)] for n in (PIXELS - dark, dark)])
            for method, error in zip(METHODS, both, strict=True)
        }
        for recipe, both in errors.items()
    }
    view: Any = SimpleNamespace(
        name=f"{ground}_{sun:g}",
        ground=ground,
        settings=SimpleNamespace(light=SimpleNamespace(sun_elevation_deg=sun), rig=SimpleNamespace(width_px=160)),
    )
    return Cell(view, {}, tallies, noise or {}, quiet, {})


def views(change, halves=(0.0, 0.0), grounds=12, **more):
    """Views of which the recipe ``cheap`` adds ``change`` to both methods, with a little scatter; ``halves`` have that
    much more error than their mean."""
    scatter = np.linspace(-0.2, 0.2, grounds)
    base = np.linspace(10, 20, grounds)
    return [
        cell(
            f"ground{k}",
            {
                CONVERGED: (base[k], base[k] - 5),
                "half_a": (base[k] + halves[0], base[k] - 5 + halves[0]),
                "half_b": (base[k] + halves[1], base[k] - 5 + halves[1]),
                "cheap": (base[k] + change[0] + scatter[k], base[k] - 5 + change[1] + scatter[k]),
            },
            **more,
        )
        for k in range(grounds)
    ]


def study(*hypotheses):
    return replace(STUDY, comparisons=(("cheap", CONVERGED),), hypotheses=hypotheses)


def changes_of(cells):
    (found,) = draw_conclusions(study(), cells, METHODS)["comparisons"]
    return found["changes"]


def test_changes_and_gaps_are_those_put_in():
    found = changes_of(views((4.0, 1.0)))
    assert found["bm"]["typical"] == pytest.approx(4, abs=0.05)
    assert found["sgbm"]["typical"] == pytest.approx(1, abs=0.05)
    # The gap from bm to sgbm is sgbm's error less bm's: it falls by 3.
    assert found["sgbm - bm"]["typical"] == pytest.approx(-3, abs=0.05)
    for change in found.values():
        assert change["low"] <= change["typical"] <= change["high"]
        assert change["low"] > change["typical"] - 0.3
        assert change["claimed"]
        assert change["noise"] == 0


def test_light_and_shadow_are_apart():
    (found,) = draw_conclusions(study(), views((4.0, 1.0)), METHODS)["comparisons"]
    assert found["by_light"]["bm, lit"]["typical"] == pytest.approx(4, abs=0.1)
    assert found["by_light"]["bm, shadow"]["grounds"] == 12
    (without,) = draw_conclusions(study(), views((4.0, 1.0), shadow=0.04), METHODS)["comparisons"]
    assert without["by_light"]["bm, shadow"]["grounds"] == 0
    assert without["by_light"]["bm, lit"]["grounds"] == 12


def test_views_of_a_ground_are_one_scene():
    cells = views((4.0, 1.0))
    twice = changes_of([*cells, *(replace(each, view=SimpleNamespace(**vars(each.view))) for each in cells)])
    assert twice == changes_of(cells)


@pytest.mark.parametrize(
    ("halves", "noise", "claimed"),
    [
        ((0.2, 0.2), 0.2, True),  # noise adds as much to the mean as each half has more: 0.2 of 4
        ((0.6, 0.6), 0.6, False),
        ((3.0, -3.0), 3 / 12**0.5, False),  # what scatters falls with the root of the grounds
    ],
)
def test_a_change_is_claimed_if_the_converged_render_has_a_tenth_of_its_noise(halves, noise, claimed):
    found = changes_of(views((4.0, 1.0), halves))
    assert found["bm"]["noise"] == pytest.approx(noise, abs=0.01)
    assert found["bm"]["found"]
    assert found["bm"]["claimed"] is claimed


def test_few_grounds_have_no_interval():
    found = changes_of(views((4.0, 1.0), grounds=5))
    assert found["bm"]["typical"] == pytest.approx(4, abs=0.2)
    assert found["bm"]["low"] is None
    assert not found["bm"]["claimed"]


def test_views_that_are_not_converged_do_not_count():
    dark = [replace(each, reference_noise=0.2) for each in views((90.0, 90.0))]
    both = draw_conclusions(study(), [*views((4.0, 1.0)), *dark], METHODS)
    assert both["comparisons"][0]["changes"] == changes_of(views((4.0, 1.0)))
    assert [each["counts"] for each in both["cells"]] == [True] * 12 + [False] * 12
    assert draw_conclusions(study(), dark, METHODS)["comparisons"][0]["changes"]["bm"]["typical"] is None


@pytest.mark.parametrize(
    ("low", "high", "halves", "verdict"),
    [
        (2.0, np.inf, 0.0, HOLDS),
        (3.9, np.inf, 0.0, OPEN),
        (5.0, np.inf, 0.0, FAILS),
        (-np.inf, 0.0, 0.0, FAILS),
        (-6.0, 6.0, 0.0, HOLDS),
        (-2.0, 2.0, 0.0, FAILS),
        (-4.0, 4.0, 0.0, OPEN),
        (2.0, np.inf, 0.5, OPEN),  # the converged render has more noise than a tenth of the bound
        (0.0, np.inf, 0.3, HOLDS),  # without a bound, the change itself counts
    ],
)
def test_a_hypothesis_holds_if_the_whole_interval_is_on_its_side(low, high, halves, verdict):
    hypothesis = Hypothesis("it is so", "cheap", CONVERGED, "bm", low, high)
    (found,) = draw_conclusions(study(hypothesis), views((4.0, 1.0), (halves, halves)), METHODS)["hypotheses"]
    assert found["verdict"] == verdict


def test_the_order_of_methods_is_counted_over_views():
    cells = views((0.0, 0.0))
    swapped = [*cells[:9], *(views((0.0, 9.0))[9:])]
    order = draw_conclusions(study(), swapped, METHODS)["comparisons"][0]["order"]
    assert order["views"] == 12
    assert order["same"] == 0.75
    assert order["tau"] == 0.5
    assert order["low"] < 0.75 < order["high"]


def test_the_order_of_noise_is_told_for_each_view_and_for_all():
    def noise(*rows):
        return {
            f"r{k}": {"verdict": "noisy", "hidden": h, "truly_hidden": d, "distance": -d, "bias": 0.0}
            for k, (h, d) in enumerate(rows)
        }

    errors = dict.fromkeys((CONVERGED, "half_a", "half_b"), (10.0, 5.0))
    cells = [
        cell("one", errors, noise((0.1, 0.1), (0.2, 0.2), (0.3, 0.3))),
        cell("other", errors, noise((0.4, 0.3), (0.5, 0.2))),
    ]
    order = draw_conclusions(study(), cells, METHODS)["noise_order"]
    found = order["truly_hidden"]
    assert found["views"] == {"one_20": 1, "other_20": -1}
    assert found["mean"] == 0
    assert found["pairs"] == 5
    # Of ten pairs of rows six agree, two do not, and two have the same distance.
    assert found["together"] == pytest.approx(4 / (10 * 8) ** 0.5, abs=1e-3)
    assert order["distance"]["views"] == {"one_20": -1, "other_20": 1}
