"""Passes as 16-bit floats: what is rounded, by how much, and what is not."""

from pathlib import Path

import numpy as np
import pytest
from icymoon.formats.exr_parts import assemble, read_pieces
from icymoon.formats.exr_pixels import Pixels, decode_parts, drop_passes, encode_part, round_passes
from icymoon.stereo.images.exr import read_view
from icymoon.support.labels import HALF_FLOAT_PASSES

#: The largest has all passes.
FILE = max(
    (Path(__file__).parent.parent / "data" / "v0_1_0" / "dataset" / "pairs").glob("*/left.exr"),
    key=lambda path: path.stat().st_size,
)


def channels_of(data):
    return {name: values for _, channels in decode_parts(data) for name, values in channels.items()}


def rounded(data, choice):
    return assemble([round_passes(piece, HALF_FLOAT_PASSES[choice]) for piece in read_pieces(data)])


@pytest.fixture(scope="module")
def stored():
    return FILE.read_bytes()


def is_rounded(name, choice):
    return ".".join(name.split(".")[:2]) in HALF_FLOAT_PASSES[choice]


@pytest.mark.parametrize("choice", ["RADIANCE", "RADIANCE_NORMALS"])
def test_the_chosen_passes_are_rounded_to_eleven_bits_and_no_other_changes(stored, choice):
    before, after = channels_of(stored), channels_of(rounded(stored, choice))
    assert before.keys() == after.keys()
    assert any(is_rounded(name, choice) for name in before)
    for name, values in before.items():
        if is_rounded(name, choice):
            assert np.array_equal(after[name], values.astype(np.float16)), name
            assert not np.array_equal(after[name], values) or not values.any() or (values == values.flat[0]).all(), name
        else:
            assert np.array_equal(after[name], values), name


def test_nothing_is_rounded_without_asking_and_files_get_smaller_with_each_step(stored):
    sizes = [len(rounded(stored, choice)) for choice in ("NONE", "RADIANCE", "RADIANCE_NORMALS")]
    assert rounded(stored, "NONE") == assemble(read_pieces(stored))
    assert sizes[0] > sizes[1] > sizes[2]


def test_openexr_reads_the_same_as_numpy(stored, tmp_path):
    pytest.importorskip("OpenEXR")
    path = tmp_path / "left.exr"
    path.write_bytes(rounded(stored, "RADIANCE_NORMALS"))
    view, full = read_view(path, "left"), read_view(FILE, "left")
    found = channels_of(path.read_bytes())
    assert view.radiance.dtype == np.float32
    for k, band in enumerate("RGB"):
        name = next(n for n in found if n.startswith("Beauty.Combined.") and n.endswith(f".{band}"))
        assert np.array_equal(view.radiance[..., k], found[name])
    assert np.array_equal(view.depth, full.depth, equal_nan=True)
    assert np.array_equal(view.instance, full.instance)
    # Two of three components of a unit vector are at most half a step of a 16-bit float off, 2^-12.
    angle = np.arccos(
        np.clip(
            (view.normal * full.normal).sum(-1)
            / np.linalg.norm(view.normal, axis=-1)
            / np.linalg.norm(full.normal, axis=-1),
            -1,
            1,
        )
    )
    assert np.degrees(np.nanmax(angle)) <= 0.03 + 0.03  # arccos of single precision is that far off by itself


@pytest.mark.parametrize("scale", [1.0e6, 1.0e-7])
def test_light_that_16_bits_cannot_carry_stays_as_it_is(stored, scale):
    for piece in read_pieces(stored):
        pixels = Pixels(piece)
        named = [k for k, name in enumerate(pixels.channels) if is_rounded(name, "RADIANCE")]
        if named:
            values = pixels.decode()
            values[:, named] *= scale
            other = Pixels(piece).encode(values)
            assert round_passes(other, HALF_FLOAT_PASSES["RADIANCE"]) is other
            return
    raise AssertionError("there is no radiance in the file")


def test_passes_can_be_dropped_and_values_read_after_rounding(stored):
    for piece in read_pieces(rounded(stored, "RADIANCE")):
        pixels = Pixels(piece)
        assert np.array_equal(Pixels(pixels.encode(pixels.decode())).decode(), pixels.decode(), equal_nan=True)
        kept = drop_passes(piece, {"Beauty.Combined"})
        if kept is not None:
            assert not any(name.startswith("Beauty.Combined.") for name in Pixels(kept).channels)


def test_a_part_encoded_in_16_bits_is_what_rounding_makes_of_it_and_is_not_rounded_again():
    values = {axis: np.random.default_rng(k).random((21, 17), np.float32) for k, axis in enumerate("RGB")}
    full, half = (encode_part("Truth.GeometricNormal", values, half) for half in (False, True))
    passes = {"Truth.GeometricNormal"}
    assert assemble([round_passes(full, passes)]) == assemble([half])
    assert round_passes(half, passes) is half
    assert channels_of(assemble([half]))["Truth.GeometricNormal.R"].tolist() == (
        values["R"].astype(np.float16).astype(np.float32).tolist()
    )
