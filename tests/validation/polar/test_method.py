"""The method is frozen on terrain 04: whoever changes a constant makes another method, and says so."""

from __future__ import annotations

from typing import Any

from icymoon.validation import polar_comparison
from icymoon.validation.polar import METHOD, camera, label_agreement, lamp, sand, scans, scene, skirts

#: By method, what its constants were when it was frozen.
FROZEN: dict[int, dict[Any, dict[str, object]]] = {
    3: {
        polar_comparison: {
            "_RENDER_COLUMNS": 480,
            "_MIN_ROCK_OVERLAP": 0.85,
            "_MIN_SHADOW_OVERLAP": 0.75,
            "_MAX_TIP_ERROR": 0.02,
            "_MAX_OUTLINE_ERROR_PX": 1.0,
            "_MAX_BASELINE_ERROR_M": 0.01,
            "_MAX_LAMP_ERROR_M": 0.3,
            "_MAX_DISPARITY_ERROR_PX": 1.0,
            "_MIN_SHADOW_M": 0.15,
            "_MAX_UNSCANNED_SHARE": 0.02,
            "_MAX_SAND_SHADOW_SHARE": 0.005,
        },
        camera: {"_SAND_SHARE": 0.25, "_MATCHED_PX": 10.0},
        label_agreement: {"_MASK_SCALE": 0.5, "_OUTLINE_STEP_PX": 8.0},
        lamp: {
            "_LAMP_STEPS_M": (0.2, 0.1, 0.05, 0.025, 0.0125),
            "_SURVEY_COST": 0.01,
            "_NODE_STEPS_M": (0.01, 0.005),
            "_NODE_REACH_M": 0.2,
            "_MAX_RAISED_M": 0.02,
            "_RAISED_COST": 5.0,
        },
        sand: {
            "SMOOTHING_LENGTH_M": 0.3,
            "NODE_SPACING_M": 0.25,
            "_PRIOR_SPREAD_M": 0.014,
            "_HEIGHT_ERROR_M": 0.004,
        },
        skirts: {"REPOSE_DEG": 35.0, "BOUND_M": 0.04, "_AVERAGING_PASSES": 2},
        scans: {"_NEAR_PX": 10.0, "_MIN_SCANNED_SHARE": 0.5},
        scene: {"_SHADOW_SHARE": 0.5, "_DARK_SHARE": 0.1, "_MIN_GAP_M": 0.002, "LAMP_DEG": 0.5, "_SAMPLES": 4},
    }
}


def test_the_constants_are_those_of_the_method():
    for module, constants in FROZEN[METHOD].items():
        for name, value in constants.items():
            assert getattr(module, name) == value, f"{module.__name__}.{name}"
    assert lamp._SURVEY_ERROR_M.tolist() == [0.2, 0.2, 0.1]
