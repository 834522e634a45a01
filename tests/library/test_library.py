"""The package as a library: scenes, arrays, pairs, evaluations and sweeps; without Blender but where it is said."""

from __future__ import annotations

import inspect
import io
import itertools
import re
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import icymoon
import numpy as np
import pairs
import pytest
from icymoon import IcyMoonError, Scene
from icymoon.formats.tiff_write import encode_tiff
from icymoon.library.inputs import make_albedo_input, make_heights_input
from icymoon.library.renderers import MessageReceiver
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.physics.mesh.height_map import place_map
from icymoon.physics.rocks.painted_mask import read_mask
from icymoon.physics.rocks.rock_table import read_rock_table
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.settings.topics.scene import Settings
from icymoon.settings.user_files import hash_content
from icymoon.support.arrays import Array
from icymoon.support.version import ROOT

SMALL: Any = {
    "rig": {"width_px": 64, "height_px": 48},
    "terrain": {"resolution": 33, "size_m": 20.0},
    "mesh": {"kind": "GRID"},
    "quality": {"samples": 2, "threads": 1},
}


@pytest.fixture
def pair(tmp_path) -> icymoon.RenderedPair:
    return icymoon.open_pair(pairs.write_pair(tmp_path / "pairs" / "0123456789ab", pairs.Scene(sky_rows=4)))


def test_the_import_is_light_and_every_name_is_there():
    program = (
        "import sys, icymoon\nheavy = {'numpy', 'bpy', 'cv2', 'rich'} & set(sys.modules)\n"
        "assert not heavy, heavy\nassert set(icymoon.__all__) <= set(dir(icymoon))\n"
        "sys.modules |= dict.fromkeys(('bpy', 'cv2', 'torch', 'OpenEXR', 'rich'))\n"
        "assert all(getattr(icymoon, name).__doc__ for name in icymoon.__all__)"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)
    with pytest.raises(AttributeError, match="scene"):
        icymoon.scene  # noqa: B018


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Scene("europa_rough_icee"), ["europa_rough_ice"]),
        (lambda: Scene(rigg={}), ["rigg", "'rig'"]),
        (lambda: Scene(rig={"width": 3}), ["rig.width", "width_px"]),
        (lambda: Scene(rig={"width_px": 2.5}), ["rig.width_px", "whole number"]),
        (lambda: Scene(rig={"baseline_m": -1}), ["rig.baseline_m", "m"]),
        (lambda: Scene().change(surface={"model": "LAMBERTT"}), ["LAMBERT"]),
    ],
)
def test_what_is_unknown_is_refused_with_the_nearest_name(make, words):
    """The type checker refuses all but the first and the fifth, too."""
    with pytest.raises(IcyMoonError) as raised:
        make()
    assert all(word in str(raised.value) for word in words)


def test_a_scene_never_changes_and_states_what_it_is():
    measured: Any = {"baseline_m": np.float64(0.5), "width_px": np.int64(64)}
    scene = Scene("europa_rough_ice", rig=measured)
    scene.settings.rig.width_px = 1
    other = scene.change(rig={"width_px": 32})
    assert (scene.settings.rig.width_px, other.settings.rig.width_px) == (64, 32)
    assert other.settings.rig.baseline_m == 0.5
    assert scene.changes["rig.width_px"] == 64
    assert "europa_rough_ice" in repr(other)
    assert "32 x " in repr(other)
    assert "width_px = 32" in other.to_toml()


def test_heights_of_a_function_are_those_of_its_places():
    """Read as the ground reads them: the height at any vertex is the function's there."""

    def height(x: Array, y: Array) -> Array:
        return 0.3 * x - 0.1 * y + 5.0

    given, stated = make_heights_input(height, 20.0, 33, None)
    source = stated["source"]
    pixel = source["metres_per_pixel"]
    ground, _ = place_map(
        np.load(io.BytesIO(given.content)),
        (pixel, pixel),
        (0.0, 0.0),
        centre=False,
        origin_m=(source["origin_x_m"], source["origin_y_m"]),
        size_m=20.0,
    )
    x, y = np.meshgrid(np.linspace(-10, 10, 7), np.linspace(-10, 10, 5))
    assert ground.heights(x, y) == pytest.approx(height(x, y), abs=1e-12)  # bilinear is exact on a plane


def test_an_array_has_the_size_that_its_spacing_gives():
    _, stated = make_heights_input(np.zeros((5, 9)), 20.0, 33, 0.5)
    assert stated["terrain"] == {"size_m": 4.0, "resolution": 9}
    assert (stated["source"]["origin_x_m"], stated["source"]["origin_y_m"]) == (2.0, 1.0)


@pytest.mark.parametrize(
    ("heights", "words"),
    [
        (np.zeros(5), "shape"),
        (np.full((3, 3), np.nan), "not finite"),
        (lambda x, y: x[:1], "shape"),
        (lambda x, y: float("1" if x > 0 else "2"), "numpy.vectorize"),
        (np.zeros((3, 3, 3)), "one height"),
        ("flat", "not an array of numbers"),
    ],
)
def test_heights_that_cannot_be_are_refused(heights, words):
    with pytest.raises(IcyMoonError, match=words):
        Scene().with_heights(heights)


def test_albedos_keep_their_mean_and_range():
    albedo = np.linspace(0.1, 0.7, 12).reshape(3, 4)
    given, stated = make_albedo_input(albedo, 20.0, 512)
    assert stated["surface"]["albedo"] == pytest.approx(0.4)
    assert given.content == encode_tiff(albedo.astype(np.float32), description="albedo")
    with pytest.raises(IcyMoonError, match="0 to 1"):
        Scene().with_albedo(albedo + 0.5)
    with pytest.raises(IcyMoonError, match="each band"):
        Scene().with_albedo(np.zeros((4, 4, 2)))


def test_rocks_are_a_table(tmp_path):
    scene = Scene().with_rocks([[1.0, 2.0, 0.5], [0.1, 0.2, 1 / 3]])
    stored = scene.stored(tmp_path)
    assert read_rock_table(Path(stored.rocks.file)).tolist() == [[1.0, 2.0, 0.5], [0.1, 0.2, 1 / 3]]
    assert stored.rocks.coverage > 0
    assert "2 own rocks" in repr(scene)
    for rocks, words in (([1, 2, 3], "shape"), ([[1, 2, 0]], "above 0"), ("rocks", "not an array")):
        with pytest.raises(IcyMoonError, match=words):
            Scene().with_rocks(rocks)


def test_a_mask_is_sampled_at_the_middles_of_pixels(tmp_path):
    scene = Scene(terrain={"size_m": 8.0}).with_mask("rocks", lambda x_m, y_m: (x_m + 4) / 8 * (y_m > 0), resolution=4)
    stored = scene.stored(tmp_path)
    assert read_mask(Path(stored.rocks.mask_file)).tolist() == [[0.125, 0.375, 0.625, 0.875]] * 2 + [[0.0] * 4] * 2
    assert "own mask of rocks 4 x 4" in repr(scene)
    for of, mask, words in (("sand", [[0, 0], [0, 0]], "no mask of"), ("frost", [[0, 0], [0, 2]], "0 to 1")):
        with pytest.raises(IcyMoonError, match=words):
            Scene().with_mask(of, mask)


def test_a_file_that_is_stated_later_takes_the_place_of_an_array(tmp_path):
    scene = Scene().with_rocks([[1.0, 2.0, 0.5]]).with_albedo(np.full((2, 2), 0.5))
    stored = scene.change(rocks={"file": "counted.csv"}).stored(tmp_path)
    assert stored.rocks.file == "counted.csv"
    assert Path(stored.textures.albedo_file).parent == tmp_path / "inputs"


def test_arrays_are_stored_once_and_named_after_their_content(tmp_path):
    scene = Scene(**SMALL).with_heights(lambda x, y: 0 * x)
    first, again = scene.stored(tmp_path), scene.stored(tmp_path)
    assert first.source.file == again.source.file
    other = Scene(**SMALL).with_heights(lambda x, y: 0 * x + 1).stored(tmp_path)
    assert len(list((tmp_path / "inputs").iterdir())) == 2
    assert Path(other.source.file).parent == tmp_path / "inputs"


def test_a_pair_is_arrays_with_units(pair):
    scene, camera = pairs.Scene(sky_rows=4), pair.camera
    depth, light, _ = pairs.view(scene, camera, "left")
    assert pair.left.radiance.shape == (*depth.shape, 3)
    assert pair.left.radiance[..., 0] == pytest.approx(light, rel=1e-6)
    assert pair.depth_m == pytest.approx(depth, rel=1e-6, nan_ok=True)
    assert pair.disparity_px == pytest.approx(camera.focal_px * camera.baseline_m / depth, rel=1e-6, nan_ok=True)
    assert not (pair.occluded & pair.visible).any()
    assert ((pair.occluded | pair.visible) == np.isfinite(depth)).all()
    assert pair.id in repr(pair)
    assert str(camera.width_px) in repr(pair.left)


def test_it_is_developed_by_another_sensor_without_a_new_render(pair):
    one, two = (pair.develop(sensor={"bits": bits}) for bits in (8, 12))
    assert (one.bits, two.bits, one.left.max() < 256) == (8, 12, True)
    assert np.array_equal(two.left, pair.develop(sensor={"bits": 12}).left), "the same settings, the same noise"
    with pytest.raises(IcyMoonError, match=r"rig\.baseline_m needs a new render"):
        pair.develop(rig={"baseline_m": 1.0})


def test_a_function_is_measured_beside_our_matchers(pair, tmp_path, undrawn):
    truth = pair.disparity_px
    asked = []

    def perfect(left, right, max_disparity_px, camera):
        asked.append((left.dtype, max_disparity_px, camera.focal_px))
        return truth, np.ones(truth.shape)

    found = icymoon.evaluate([pair], ["bm:window=9", perfect], tmp_path / "evaluation")
    assert set(found.summary) == {"bm:window=9", "perfect"}
    assert found.summary["perfect"]["epe_px"] == pytest.approx(0.0, abs=1e-4)  # written as single precision
    assert found.summary["perfect"]["coverage"] == 1.0
    assert found.summary["perfect"]["own_ece"] == 0.0
    assert "own_ece" not in found.summary["bm:window=9"]
    assert asked[0][0] == np.uint8
    assert asked[0][2] == pair.camera.focal_px
    assert found.report.is_file()
    assert "perfect" in repr(found)


def test_a_function_that_changed_is_measured_anew(pair, tmp_path, undrawn):
    """Results are kept by the content of the disparities, so no result of another function is taken for its own."""
    errors = [
        icymoon.evaluate(pair, {"mine": lambda left, right, off=off: pair.disparity_px + off}, tmp_path / "e").summary[
            "mine"
        ]["epe_px"]
        for off in (0.25, 1.5)
    ]
    assert errors == pytest.approx([0.25, 1.5], abs=1e-4)


@pytest.mark.parametrize(
    ("matcher", "words"),
    [
        (lambda left, right: left[:2], "shape"),
        ("sgbmm", "sgbm"),
        (lambda left, right: np.full(left.shape, np.nan), "mine|lambda"),
    ],
)
def test_a_matcher_that_cannot_be_is_a_sentence(pair, tmp_path, matcher, words):
    with pytest.raises(IcyMoonError, match=words):
        icymoon.evaluate(pair, [matcher], tmp_path / "evaluation")


def test_two_functions_of_one_name_are_refused(pair, tmp_path):
    with pytest.raises(IcyMoonError, match="2 matchers have the name <lambda>"):
        icymoon.evaluate(pair, [lambda left, right: 0.0 * left, lambda left, right: left], tmp_path / "evaluation")


class Counting:
    """A renderer that copies a synthetic pair into the folder that the settings' pair has, and counts."""

    def __init__(self) -> None:
        self.rendered: list[Settings] = []

    def render(self, settings: Settings, dataset: Path, again: bool, hear: MessageReceiver) -> list[Path]:
        self.rendered.append(settings)
        hear({"type": "warning", "message": "a warning"})
        (planned,) = expand_headings(settings, hash_content(settings))
        camera = StereoCamera.from_settings(settings.rig)
        return [pairs.write_pair(planned.folder(dataset), pairs.Scene(), camera, settings=settings)]

    def close(self) -> None:
        """Nothing is held."""


def test_a_sweep_goes_on_where_it_was_stopped(tmp_path):
    scene = Scene(**SMALL)
    vary: Any = {
        "heights": {"flat": lambda x, y: 0 * x, "tilted": lambda x, y: 0.1 * x},
        "light.sun_elevation_deg": np.array([5.0, 20.0]),
    }
    first = Counting()
    sweep = icymoon.Sweep(scene, tmp_path, vary, renderer=first)
    assert len(sweep) == 4
    assert "2 heights x 2 light.sun_elevation_deg" in repr(sweep)
    with pytest.warns(UserWarning, match="a warning"):
        assert [point.values for point in itertools.islice(sweep, 2)][-1] == {
            "heights": "flat",
            "light.sun_elevation_deg": 20.0,
        }
    assert len(first.rendered) == 2
    second = Counting()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        points = list(icymoon.Sweep(scene, tmp_path, vary, renderer=second))
    assert [s.light.sun_elevation_deg for s in second.rendered] == [5.0, 20.0]
    assert len({point.pair.id for point in points}) == 4


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ({"light.sun_elevation": [1]}, "sun_elevation_deg"),
        ({"heights": [1]}, "need names"),
        ({"rig.baseline_m": []}, "list of values"),
        ({"rig.baseline_m": [-5]}, "outside"),
    ],
)
def test_a_sweep_that_cannot_be_is_refused_before_anything_is_rendered(tmp_path, vary, words):
    with pytest.raises(IcyMoonError, match=words):
        icymoon.Sweep(Scene(), tmp_path, vary)


def test_the_reference_page_has_every_name_and_every_member_is_described():
    sys.path.insert(0, str(ROOT / "docs" / "make"))
    import python_api

    assert sorted(python_api.ORDER) == sorted(icymoon.__all__)
    page = python_api.page()
    assert " at 0x" not in page
    assert "### Scene.with_heights" in page
    bare = [
        f"{name}.{key}"
        for name in icymoon.__all__
        if inspect.isclass(kind := getattr(icymoon, name))
        for key, member in vars(kind).items()
        if not key.startswith("_")
        and (inspect.isfunction(member) or isinstance(member, property))
        and not member.__doc__
    ]
    assert not bare


def test_the_page_of_the_manual_uses_names_that_are_there():
    page = (ROOT / "docs" / "howto" / "python.md").read_text(encoding="utf-8")
    used = set(re.findall(r"icymoon\.([A-Za-z_]+)\(", page))
    assert used >= {"Scene", "Sweep", "Worker", "evaluate"}
    assert used <= set(icymoon.__all__)


@pytest.mark.parametrize("name", ["../out", "a/b", "a=b", "", "x" * 41])
def test_names_of_functions_that_no_folder_can_have_are_refused(name, tmp_path):
    with pytest.raises(IcyMoonError, match="give it a name"):
        icymoon.evaluate(tmp_path, {name: lambda left, right: left}, tmp_path / "out")


@pytest.mark.skipif(sys.platform == "win32", reason="links need a privilege on Windows")
@pytest.mark.parametrize("planted", ["folder", "file"])
def test_arrays_are_not_stored_through_a_link_that_was_planted(planted, tmp_path):
    scene = icymoon.Scene("enceladus_fresh_snow").with_heights(np.zeros((4, 4)))
    elsewhere, dataset = tmp_path / "elsewhere", tmp_path / "set"
    elsewhere.mkdir()
    if planted == "folder":
        dataset.mkdir()
        (dataset / "inputs").symlink_to(elsewhere)
    else:
        path = Path(scene.stored(dataset).source.file)
        path.rename(elsewhere / path.name)
        path.symlink_to(elsewhere / path.name)
    before = sorted(elsewhere.iterdir())
    with pytest.raises(IcyMoonError, match="is a link"):
        scene.stored(dataset)
    assert sorted(elsewhere.iterdir()) == before


def test_a_stored_array_that_was_changed_is_stored_again(tmp_path):
    scene = icymoon.Scene("enceladus_fresh_snow").with_heights(np.zeros((4, 4)))
    path = Path(scene.stored(tmp_path).source.file)
    whole = path.read_bytes()
    path.write_bytes(whole[:-8])
    assert Path(scene.stored(tmp_path).source.file).read_bytes() == whole
