"""The line of the sidebar that names the next step."""

import json

import bpy
import pytest
from evaluations import ROW, write_evaluation
from icymoon.nodes import preview
from icymoon.nodes.build_scene import find_built
from icymoon.operators import last_variations, next_step, results
from icymoon.operators.session import session
from icymoon.settings.blender import scene_properties


@pytest.fixture
def rendered(small):
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    assert next_step.find_next_step(small) == "Next: Render Stereo Pair"
    assert bpy.ops.icymoon.render_pair() == {"FINISHED"}
    yield small
    session.reset()


def evaluate(scene):
    settings = scene_properties.read_settings(scene.icymoon)
    write_evaluation(results.find_evaluation_folder(settings, "SCENE"), ROW)
    results.keep_results(scene, "SCENE", settings, scene.icymoon.pairs.split())


def test_a_pair_of_other_settings_is_rendered_again(rendered):
    assert next_step.find_next_step(rendered) == "Next: Evaluate Stereo Pair"
    rendered.icymoon.dataset.methods = "bm"
    assert next_step.find_next_step(rendered) == "Next: Evaluate Stereo Pair"
    before = rendered.icymoon.light.sun_elevation_deg
    rendered.icymoon.light.sun_elevation_deg = before + 5
    assert next_step.find_next_step(rendered) == "Next: Render Stereo Pair"
    rendered.icymoon.light.sun_elevation_deg = before
    evaluate(rendered)
    assert next_step.find_next_step(rendered) == "Next: Stereo Error, below"
    rendered.icymoon.dataset.methods = "sgbm"
    assert next_step.find_next_step(rendered) == "Next: Evaluate Stereo Pair"
    rendered.icymoon.light.sun_elevation_deg = before + 5
    assert next_step.find_next_step(rendered) == "Next: Render Stereo Pair"


def test_after_decisions_their_answer_is_next(rendered):
    evaluate(rendered)
    session.decided[rendered.session_uid] = ("No site is safe by the rules.",)
    assert next_step.find_next_step(rendered) == "Next: Stereo Error, below"
    session.ended = "Decide: done"
    assert next_step.find_next_step(rendered) == "Next: Evaluation, at its end"
    session.ended = "Evaluate Stereo Pair: done"
    assert next_step.find_next_step(rendered) == "Next: Stereo Error, below"


def test_after_an_evaluation_of_variations_its_results_are_next(rendered):
    evaluate(rendered)
    kept = json.loads(rendered.icymoon.results)
    rendered.icymoon.results = json.dumps(kept | {"scope": last_variations.SCOPE, "pairs": []})
    assert next_step.find_next_step(rendered) == "Next: Stereo Error, below"


def test_after_vary_the_variations_are_next(rendered):
    assert next_step.find_next_step(rendered).startswith("Next: Evaluate")
    bpy.ops.icymoon.vary(setting="surface.albedo")
    assert next_step.find_next_step(rendered) == "Next: Vary This Scene, below"
    bpy.ops.icymoon.variation_remove()
    assert next_step.find_next_step(rendered).startswith("Next: Evaluate")


def test_a_choice_that_the_render_makes_is_no_other_setting(small):
    small.icymoon.quality.indirect = "AUTO"
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    assert bpy.ops.icymoon.render_pair() == {"FINISHED"}
    assert next_step.find_next_step(small) == "Next: Evaluate Stereo Pair"
    small.icymoon.quality.indirect = "BAKED"
    assert next_step.find_next_step(small) == "Next: Render Stereo Pair"
    session.reset()


def test_a_placed_trench_is_dug_by_a_build(small):
    """The ground that follows a slider has no trench, and nothing near the top of the sidebar said so."""
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    assert next_step.find_next_step(small) == "Next: Render Stereo Pair"
    small.icymoon.excavation.path = "ARC"
    preview.show_settings(find_built(small), scene_properties.read_settings(small.icymoon), 33)
    assert next_step.find_next_step(small) == "Next: Build Scene"
