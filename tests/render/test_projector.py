"""Stripes by rays against stripes that Cycles renders, and pairs and codes in the light of a projector."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from icymoon.commands.projector import add_projector
from icymoon.nodes.build_scene import Built, build_scene
from icymoon.nodes.tree.builder import WHITE, Tree
from icymoon.physics.projector.device import Projector
from icymoon.physics.projector.patterns import Pattern
from icymoon.rays.embree import load_library
from icymoon.render import projector_worker
from icymoon.render.pairs.pair_folder import Pair, read_pair
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.projector_worker import ProjectRequest
from icymoon.render.worker import render_pairs
from icymoon.render.workers.verify_dataset import verify_data_set
from icymoon.settings.topics.scene import Settings
from icymoon.stereo.images.exr import read_view
from icymoon.stereo.projected_pairs import (
    Projection,
    WhiteLight,
    decode_pair,
    describe_projector,
    develop_patterns,
    find_refusal,
    read_projection,
    save_projected_pair,
)
from icymoon.support.blender import compat
from icymoon.support.errors import IcyMoonError
from lit_scenes import NIGHT
from rendering import SMALL, complete, empty_scene

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(load_library() is None, reason="there is no Embree; pip install embreex"),
]
GROUND: dict[str, Any] = {
    **SMALL,
    "terrain": {"resolution": 65, "size_m": 12.0, "rms_slope_deg": 12.0},
    "surface": {"grain_amplitude_m": 0.0, "albedo_variation": 0.0, "specular": 0.0, "model": "LAMBERT"},
    "quality": {"diffuse_bounces": 0, "samples": 400, "threads": 2, "truth_by": "RAYS"},
    "rig": {"width_px": 48, "height_px": 36, "pitch_deg": 60.0, "height_m": 2.0},
    "light": NIGHT,
}
PROJECTOR = Projector(96, 72, 70.0, 20.0, right_m=0.3)


def quiet(*words: object, **facts: object) -> None: ...


def render(folder: Path, settings: Settings, change: Any = lambda built: None) -> Pair:
    built = build_scene(empty_scene(), settings)
    change(built)
    (made,) = render_pairs(built, expand_headings(settings, built.extra), folder, 1, 0.0, quiet)
    return read_pair(made)


def project(folder: Path, settings: Settings, pattern: Pattern) -> Projection:
    projector_worker.run_job({"settings": settings}, folder, ProjectRequest(PROJECTOR, pattern, 4), quiet)
    (found,) = folder.iterdir()
    return read_projection(found / "projected.npz")


def shine_stripes(built: Built) -> None:
    """Make the last lamp shine stripes along its rows, by its nodes: (1 + cos(2π u / 24)) / 2 at the column u."""
    lamp = built.lamps[-1].data
    lamp.use_soft_falloff = True  # the normal of a lamp is then the direction of its light
    tree = Tree(compat.ensure_light_nodes(lamp))
    normal = tree.node("ShaderNodeTexCoord", "Place", {}).outputs["Normal"]
    split = tree.node("ShaderNodeSeparateXYZ", "Axes", {"Vector": normal})
    across = tree.math("DIVIDE", "Across", split.outputs["X"], tree.math("MULTIPLY", "Ahead", split.outputs["Z"], -1.0))
    column = tree.math("MULTIPLY", "Column", across, PROJECTOR.focal_px * 2 * np.pi / 24.0)
    cosine = tree.node("ShaderNodeMath", "Wave", {"Value": column}, operation="COSINE", use_clamp=False)
    # The middle of the field is at a whole number of periods.
    wave = tree.math("MULTIPLY", "Half", tree.math("ADD", "Up", cosine.outputs[0], 1.0), 0.5)
    tree.node("ShaderNodeOutputLight", "Light", {"Surface": tree.emission("Lamp", WHITE, wave)}, target="ALL")


@pytest.fixture(scope="module")
def white(tmp_path_factory: pytest.TempPathFactory) -> Pair:
    return render(tmp_path_factory.mktemp("white"), add_projector(complete(GROUND), PROJECTOR))


def test_stripes_by_rays_are_those_that_cycles_renders(tmp_path, white):
    striped = render(tmp_path / "striped", white.settings, shine_stripes)
    found = project(tmp_path / "rays", white.settings, Pattern("STRIPES", period_px=24.0))
    light, place = WhiteLight.read(white, None), found.place["left"]
    made = light.mix("left", found.share["left"][0], 0.0)[..., 0]
    real = read_view(striped.image("left")).groups["Lamp1"][..., 0]
    inner = np.all((place > 3) & (place < [PROJECTOR.columns - 3, PROJECTOR.rows - 3]), axis=-1)
    assert inner.mean() > 0.4
    off = (made - real)[inner] / light.direct["left"][..., 0][inner]
    assert abs(off.mean()) < 2e-3
    # Lines between the middles of pixels take 0.6 % of the contrast of such stripes.
    assert np.quantile(np.abs(off), 0.99) < 1e-2


def test_a_pair_in_the_light_of_dots_is_read_verified_and_as_bright_as_its_dots(tmp_path, white):
    pattern = Pattern("DOTS", dots=60, dot_px=3.0)
    found, light = project(tmp_path / "rays", white.settings, pattern), WhiteLight.read(white, None)
    facts = describe_projector(PROJECTOR, pattern, found.pose)
    folder = save_projected_pair(white, light, found, facts, tmp_path / "set")
    pair = read_pair(folder)
    assert pair.id != white.id
    assert save_projected_pair(white, light, found, facts, tmp_path / "set") == folder
    assert not verify_data_set(tmp_path / "set").problems
    for eye in ("left", "right"):
        before, after = read_view(white.image(eye)), read_view(pair.image(eye))
        wanted = before.groups["Lamp1"] * found.share[eye][0][..., None]
        np.testing.assert_allclose(after.groups["Lamp1"], wanted, rtol=2.0**-10, atol=1e-6)  # 16-bit floats
        np.testing.assert_allclose(after.radiance, wanted, rtol=2.0**-10, atol=1e-6)
        np.testing.assert_array_equal(after.depth, before.depth)
    assert 0.02 < after.radiance.sum() / before.radiance.sum() < 0.3


def test_codes_in_noisy_images_give_columns_and_depths(tmp_path, white):
    pattern = Pattern("GRAY_PHASE", period_px=16.0)
    found, light = project(tmp_path / "rays", white.settings, pattern), WhiteLight.read(white, None)
    images, bits = develop_patterns(white, light, found, white.settings)
    assert len(images["left"]) == len(found.mean) == 10
    decoded = {
        eye: each.summarise() for eye, each in decode_pair(white, images, bits, found, PROJECTOR, pattern).items()
    }
    for errors in decoded.values():
        assert errors["decoded_share"] > 0.8
        assert errors["column_median_px"] < 0.1
    assert decoded["left"]["depth_median_share"] < 5e-3  # the right eye is beside the projector


def test_a_projector_in_the_ground_and_a_camera_that_moves_are_one_sentence(tmp_path):
    buried = add_projector(complete(GROUND), Projector(96, 72, up_m=-5.0))
    with pytest.raises(IcyMoonError, match=r"light.lamps\[0\] is .* under the ground"):
        project(tmp_path / "rays", buried, Pattern())
    assert "set rig.readout_s to 0" in find_refusal(complete(GROUND, {"rig": {"readout_s": 0.01}}))
    assert not find_refusal(buried)


def test_a_pattern_that_lights_nothing_in_sight_is_refused():
    """As one that misses the ground does, or lights ground behind the cameras."""
    dark, lit = np.zeros((2, 3, 4), np.float32), np.zeros((2, 3, 4), np.float32)
    lit[1, 2, 3] = 1e-3
    with pytest.raises(IcyMoonError, match="lights nothing that the cameras see; turn the projector"):
        projector_worker.refuse_dark([dark, dark])
    projector_worker.refuse_dark([dark, lit])
