"""The channel with the map is taken where names leave no other; otherwise the user states it."""

from __future__ import annotations

import foreign
import numpy as np
import OpenEXR
import pytest
from icymoon.stereo.datasets.data_files import MapFile, read_map
from icymoon.stereo.datasets.map_channels import choose_array, choose_channel
from icymoon.stereo.evaluated_pairs import find_sources
from icymoon.support.errors import IcyMoonError
from icymoon.support.foreign_bytes import RefusedError

HEADER = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
NORMAL = dict.fromkeys("XYZ", foreign.constant(0.5))
PICTURE = dict.fromkeys("RGB", foreign.constant(3))


def write_layers(path, **layers):
    """A file of one part; each layer is a dict of components."""
    OpenEXR.File(
        HEADER, {f"{layer}.{own}": values for layer, channels in layers.items() for own, values in channels.items()}
    ).write(str(path))
    return path


def write_parts(path, *parts):
    """A file of several parts, each a name and its channels, which are called by their component alone."""
    OpenEXR.File([OpenEXR.Part(HEADER | {"name": name}, channels) for name, channels in parts]).write(str(path))
    return path


@pytest.mark.parametrize(
    ("names", "chosen"),
    [
        (["any"], "any"),
        (["R", "Z"], "Z"),
        (["a.Y", "b.depth"], "b.depth"),
        (["R", "G", "B"], "R"),
        (["depth.R", "depth.G", "depth.B", "depth.A"], "depth.R"),
        (["N.X", "N.Y", "N.Z", "p.Z"], "p.Z"),
        (["V.Denoising Depth.Z", "V.Depth.Z", "V.Mist.Z"], "V.Depth.Z"),
        (["Z", "ZBack", "A"], "Z"),
        (["depth.Z", "disparity.Y"], "depth.Z"),
        (["Depth", "depth_error"], "Depth"),
        (["depth_m", "R"], "depth_m"),
    ],
)
def test_the_likeliest_channel_is_taken(names, chosen):
    assert choose_channel(names, "depth") == chosen
    assert choose_channel(names[::-1], "depth") == chosen


@pytest.mark.parametrize(
    "names",
    [
        ["Main.Depth.Z", "Background.Depth.Z"],
        ["depth1", "depth2"],
        ["Depth.left.Z", "Depth.right.Z"],
        ["a.Z", "b.Z"],
        ["a.R", "a.G", "a.B", "b.R", "b.G", "b.B"],
    ],
)
def test_several_that_may_be_it_are_refused_with_their_names(names):
    for predicted, fix in ((False, "state one of them as truth.channel"), (True, "keep one of them")):
        with pytest.raises(RefusedError, match=fix) as caught:
            choose_channel(names, "depth", predicted)
        assert sum(name in str(caught.value) for name in names) > 1
        assert ("pairs.toml" in str(caught.value)) != predicted


@pytest.mark.parametrize(
    "names", [["X", "Y", "Z"], ["Normal.X", "Normal.Y", "Normal.Z"], ["a", "b"], ["VL.Position.X", "VL.Position.Z"]]
)
def test_a_direction_is_never_offered_as_a_depth(names):
    with pytest.raises(RefusedError, match=r"write the depths as the channel depth.Y") as caught:
        choose_channel(names, "depth")
    assert "map Z" not in str(caught.value)
    assert choose_channel([*names, "depth.Y"], "depth") == "depth.Y"  # the fix works


def test_channels_of_parts_are_called_by_their_part(tmp_path):
    depth = ("depth", {"Z": foreign.constant(7)})
    for k, parts in enumerate(
        [
            [depth, ("rgba", PICTURE), ("N", NORMAL)],
            [("N", NORMAL), ("rgba", PICTURE), depth],
            [("rgba", PICTURE), depth, ("N", NORMAL)],
        ]
    ):
        path = write_parts(tmp_path / f"{k}.exr", *parts)
        np.testing.assert_array_equal(read_map(MapFile(path, "depth")), foreign.constant(7))
        np.testing.assert_array_equal(read_map(MapFile(path, "depth", channel="N.Z")), foreign.constant(0.5))
    blender = write_parts(
        tmp_path / "b.exr",
        ("V.Depth", {"V.Depth.Z": foreign.constant(4)}),
        ("V.Normal", {f"V.Normal.{own}": values for own, values in NORMAL.items()}),
    )
    np.testing.assert_array_equal(read_map(MapFile(blender, "depth", channel="V.Depth.Z")), foreign.constant(4))


def test_a_layer_is_taken_only_if_it_is_stated(tmp_path):
    def folder(name, stated=""):
        root = foreign.plain(tmp_path / name, f'depth = "truth/{{pair}}.exr"{stated}')
        (root / "truth").mkdir()
        write_layers(
            root / "truth" / "a.exr",
            Main={"Depth.Z": foreign.constant(10)},
            Background={"Depth.Z": foreign.constant(30)},
        )
        (source,) = find_sources([root])
        return source

    with pytest.raises(IcyMoonError, match=r"a.exr: has several.*Background.Depth.Z, Main.Depth.Z; state one of them"):
        folder("unsaid").prepare({})
    prepared = folder("stated", '\nchannel = "Main.Depth.Z"').prepare({})
    np.testing.assert_allclose(prepared.truth, 10)
    with pytest.raises(IcyMoonError, match=r"a.exr: has no Depth.Z, which truth.channel .* Main.Depth.Z; state one of"):
        folder("wrong", '\nchannel = "Depth.Z"').prepare({})


def test_a_channel_is_stated_only_of_files_that_have_some(tmp_path):
    np.save(tmp_path / "a.npy", foreign.constant())
    with pytest.raises(IcyMoonError, match=r"has no channels with names, and truth.channel .* leave it out"):
        read_map(MapFile(tmp_path / "a.npy", channel="Z"))


def test_an_array_is_taken_by_the_kind_of_the_map(tmp_path):
    both, only = tmp_path / "both.npz", tmp_path / "only.npz"
    np.savez(both, depth=foreign.constant(4), disparity=foreign.constant(9), K=np.eye(3))
    np.savez(only, any=foreign.constant(5))
    for kind, value in (("depth", 4), ("disparity", 9)):
        np.testing.assert_array_equal(read_map(MapFile(both, kind)), foreign.constant(value))
        np.testing.assert_array_equal(read_map(MapFile(only, kind)), foreign.constant(5))
    np.testing.assert_array_equal(read_map(MapFile(both, "depth", channel="disparity")), foreign.constant(9))
    with pytest.raises(IcyMoonError, match=r"has no Z, which truth.channel in pairs.toml states, but depth, disparity"):
        read_map(MapFile(both, channel="Z"))
    with pytest.raises(RefusedError, match=r"call the one with the depths depth, or state it as truth.channel"):
        choose_array(["a", "b"], "depth")
    with pytest.raises(RefusedError, match=r"call the one with the disparities disparity.$"):
        choose_array(["a", "b"], "disparity", predicted=True)


@pytest.mark.parametrize("others", [{}, {"disp.u": foreign.constant(2)}], ids=["alone", "beside another channel"])
def test_a_colour_is_a_map_only_if_all_are_equal(tmp_path, others):
    grey = {colour: foreign.constant(7) for colour in "RGB"}
    np.testing.assert_array_equal(read_map(MapFile(_write(tmp_path / "grey.exr", grey | others))), 7)
    for colour in "GB":
        path = _write(tmp_path / f"{colour}.exr", grey | {colour: foreign.constant(8)} | others)
        for predicted in (False, True):
            words = r"of which R is a colour of a picture .*as the channel disparity"
            with pytest.raises(IcyMoonError, match=words) as caught:
                read_map(MapFile(path, predicted=predicted))
            assert all(name in str(caught.value) for name in others)
            assert ("truth.channel" in str(caught.value)) != predicted
        np.testing.assert_array_equal(read_map(MapFile(path, channel=colour)), 8)  # the fix works


def _write(path, channels):
    OpenEXR.File(HEADER, channels).write(str(path))
    return path
