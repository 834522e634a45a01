"""Reading multilayer EXR files in the layouts of Blender 4 and 5, whole and damaged, by OpenEXR and in numpy."""

import sys
from functools import partial

import numpy as np
import OpenEXR
import pairs
import pytest
from icymoon.formats.exr_parts import join_layers, read_pieces
from icymoon.formats.exr_pixels import drop_passes
from icymoon.stereo.images.exr import (
    NORMAL_PASSES,
    OBJECT_PASSES,
    read_depth,
    read_light,
    read_view,
)
from icymoon.support.errors import IcyMoonError
from icymoon.support.labels import GROUP_PASSES

SCENE = pairs.Scene(sky_rows=12)
LAYOUTS = ["4.x", "4.x view", "5.x"]


@pytest.fixture(params=["OpenEXR", "numpy"], autouse=True)
def decoder(request, monkeypatch):
    if request.param == "numpy":
        monkeypatch.setitem(sys.modules, "OpenEXR", None)  # as in Blender, where it cannot be imported


@pytest.fixture(params=LAYOUTS)
def layout(request):
    return request.param


def test_every_layout_gives_the_same_view(tmp_path, layout):
    folder = pairs.write_pair(tmp_path / "pair", SCENE, layout=layout)
    for eye in ("left", "right"):
        depth, light, instance = pairs.view(SCENE, pairs.camera(), eye)
        view = read_view(folder / f"{eye}.exr", eye)
        np.testing.assert_array_equal(view.depth, depth.astype(np.float32))  # NaN where there is sky
        np.testing.assert_array_equal(view.radiance, np.repeat(light.astype(np.float32)[..., None], 3, axis=-1))
        np.testing.assert_array_equal(view.instance, instance)
        assert set(np.unique(view.semantic)) == {0, 1, 2}
        assert view.normal.shape == (*depth.shape, 3)
        assert np.isnan(view.depth).sum() == 12 * depth.shape[1]


def test_parts_that_are_read_alone_are_the_same(tmp_path, layout):
    path = pairs.write_pair(tmp_path / "pair", SCENE, layout=layout, planet_share=0.25) / "right.exr"
    whole, light, depth = read_view(path, "right"), read_light(path, "right"), read_depth(path, "right")
    np.testing.assert_array_equal(light.radiance, whole.radiance)
    np.testing.assert_array_equal(light.groups["Planet"], whole.groups["Planet"])
    np.testing.assert_array_equal(depth.depth, whole.depth)
    np.testing.assert_array_equal(depth.semantic, whole.semantic)


def test_a_view_is_the_same_without_passes_that_nobody_needs(tmp_path, layout):
    folder = pairs.write_pair(tmp_path / "pair", layout=layout, planet_share=0.2)
    whole = read_view(folder / "left.exr", "left")
    view = read_view(folder / "left.exr", "left", (*OBJECT_PASSES, *NORMAL_PASSES, *GROUP_PASSES))
    for name in ("radiance", "depth", "semantic"):
        np.testing.assert_array_equal(getattr(view, name), getattr(whole, name))
    assert (view.instance is None, view.normal is None, not view.groups) == (True,) * 3


def test_ids_are_rounded(tmp_path):
    depth = np.ones((4, 6))
    pairs.write_exr(tmp_path / "left.exr", depth, depth, np.full((4, 6), 1000.4), "5.x", "left")
    assert (read_view(tmp_path / "left.exr").instance == 1000).all()


def test_one_view_is_picked_from_a_file_with_both(tmp_path):
    channels = {}
    for value, eye in enumerate(("left", "right"), start=1):
        channels |= {f"Beauty.Combined.{eye}.{band}": np.full((4, 6), value, np.float32) for band in "RGBA"}
        channels[f"Truth.Depth.{eye}.Z"] = np.full((4, 6), 10 * value, np.float32)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, channels).write(str(tmp_path / "both.exr"))
    for value, eye in enumerate(("left", "right"), start=1):
        view = read_view(tmp_path / "both.exr", eye)
        assert (view.radiance[0, 0, 0], view.depth[0, 0]) == (value, 10 * value)


@pytest.mark.parametrize("rows", [None, range(5, 9)])
def test_an_image_that_is_not_stored_is_the_sum_of_its_lights(tmp_path, layout, rows):
    path = pairs.write_pair(tmp_path / "pair", SCENE, layout=layout, planet_share=0.25) / "left.exr"
    whole = read_view(path, "left", rows=rows)
    less = partial(drop_passes, unwanted={"Beauty.Combined"})
    path.write_bytes(join_layers({"": read_pieces(path.read_bytes())}, less))
    view, light = read_view(path, "left", rows=rows), read_light(path, "left", rows=rows)
    for found in (view, light):
        np.testing.assert_allclose(found.radiance, whole.radiance, rtol=1e-6)
        assert found.radiance.dtype == np.float32
        np.testing.assert_array_equal(found.groups["Planet"], whole.groups["Planet"])
    for found in (read_view(path, "left", GROUP_PASSES, rows), read_light(path, "left", groups=False, rows=rows)):
        np.testing.assert_array_equal(found.radiance, view.radiance)
        assert not found.groups


def test_the_facets_normal_is_preferred(tmp_path):
    channels = {f"Beauty.Combined.{band}": np.ones((4, 6), np.float32) for band in "RGBA"}
    channels |= {"Truth.Depth.Z": np.ones((4, 6), np.float32)}
    channels |= {f"Truth.Normal.{axis}": np.zeros((4, 6), np.float32) for axis in "XYZ"}
    channels |= {f"Truth.GeometricNormal.{band}": np.full((4, 6), k, np.float32) for k, band in enumerate("RGB", 1)}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, channels).write(str(tmp_path / "left.exr"))
    view = read_view(tmp_path / "left.exr")
    assert view.normal[0, 0].tolist() == [1, 2, 3]
    assert view.instance is None


@pytest.mark.parametrize("kept", [0.0, 0.02, 0.5, 0.999])
def test_a_truncated_file_is_refused_without_noise(tmp_path, layout, kept, capfd):
    path = pairs.write_pair(tmp_path / "pair", SCENE, layout=layout) / "left.exr"
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(IcyMoonError, match=r"left\.exr"):
        read_view(path)
    assert capfd.readouterr() == ("", "")


def test_files_that_are_something_else(tmp_path):
    with pytest.raises(IcyMoonError, match="missing"):
        read_view(tmp_path / "none.exr")
    (tmp_path / "text.exr").write_text("no image at all")
    with pytest.raises(IcyMoonError, match="is not an EXR file that can be read"):
        read_view(tmp_path / "text.exr")
    channels = {f"Beauty.Combined.{band}": np.ones((4, 6), np.float32) for band in "RGBA"}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, channels).write(str(tmp_path / "flat.exr"))
    with pytest.raises(IcyMoonError, match=r"no channel Truth\.Depth\.Z"):
        read_view(tmp_path / "flat.exr")
