"""GeoTIFF files that GDAL wrote: the same hill in every unit, scale, order and direction, or a sentence."""

from __future__ import annotations

import contextlib
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from icymoon.formats import geotiff, tiff
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from icymoon.support.foreign_bytes import Budget, ForeignBytes
from tiffs import write_tiff

DATA = Path(__file__).parents[1] / "data" / "heights"
SURVEY_FOOT_M = 1200 / 3937
#: Step of the stored values in metres, of those that are whole numbers; floats round to half of 2^-23 of themselves.
STEPS_M = {"scaled": 0.004, "lzw_words": 0.004, "packbits": 0.004, "long_words": 0.001}
HALF_STEPS = {"half_floats": 2.0**-10}  # GDAL cuts them off, which is a whole step
REFUSED = {
    "unit_unknown": r"furlong.*gdal_edit\.py -units m unit_unknown",
    "depths": r"depths \(EPSG:5715\)",
    "lerc": "LERC.*gdal_translate",
}
UNPLACED = {"feet_by_number": r"EPSG:2263.*GEOTIFF_VERSION=1\.0"}
NAMES = sorted(path.stem for path in DATA.glob("*.tif"))


def hill(east_m: Any, north_m: Any) -> Any:
    """The height in metres, of a place or of an array of them, as in tests/data/heights/make.py."""
    return 40.0 + 0.5 * (east_m - 1000.0) + 0.25 * (north_m + 500.0) + 0.01 * (east_m - 1000.0) * (north_m + 500.0)


def expected(read: geotiff.GeoTiff) -> Array:
    """The hill at the places where the file says that its pixels are."""
    rows, columns = read.heights_m.shape
    east = read.corner_m[0] + read.pixel_m[0] * np.arange(columns)
    north = read.corner_m[1] + read.pixel_m[1] * np.arange(rows)[::-1]
    return hill(east[None, :], north[:, None])


@pytest.mark.parametrize("name", sorted(set(NAMES) - {*REFUSED, *UNPLACED, "degrees"}))
def test_heights_are_in_metres_where_the_hill_is(name):
    read = geotiff.read(DATA / f"{name}.tif")
    # A stated place is off by the rounding of its unit only; the hill has its corner at (1000, -500).
    assert read.pixel_m == pytest.approx((2.0, 3.0), rel=1e-12)
    assert read.corner_m == pytest.approx((1001.0, -500.0 - 3.0 * (read.heights_m.shape[0] - 0.5)), rel=1e-12)
    wrong = np.abs(read.heights_m - expected(read))
    rows, columns = read.heights_m.shape
    holes = np.eye(rows, columns, dtype=bool) if name in ("scaled", "mask") else np.zeros((rows, columns), bool)
    assert np.array_equal(np.isnan(read.heights_m), holes)
    stored = STEPS_M[name] / 2 if name in STEPS_M else HALF_STEPS.get(name, 2.0**-24) * np.abs(expected(read))
    assert np.nanmax(wrong - stored) <= 1e-9  # some roundings of float64 at 1e3 m


def test_pixels_in_degrees_have_the_size_that_they_have_on_the_equator():
    """Without a site, on the sphere that the file states; the scale at a site is that of its latitude."""
    assert geotiff.read(DATA / "degrees.tif").pixel_m == pytest.approx((2.0, 3.0), rel=1e-4)


def test_every_kind_of_file_is_there():
    assert len(NAMES) == 29


@pytest.mark.parametrize("name", sorted(REFUSED))
def test_what_cannot_be_read_is_a_sentence_with_the_mend(name):
    with pytest.raises(IcyMoonError, match=rf"{name}\.tif: .*{REFUSED[name]}"):
        geotiff.read(DATA / f"{name}.tif")


@pytest.mark.parametrize("name", sorted(UNPLACED))
def test_pixels_in_no_known_unit_of_length_have_no_size(name):
    read = geotiff.read(DATA / f"{name}.tif")
    assert (read.pixel_m, read.corner_m) == (None, None)
    assert pytest.approx(hill(1001.0, -501.5)) == read.heights_m[0, 0]
    assert re.search(UNPLACED[name], read.unplaced)


def test_what_is_assumed_or_followed_is_said():
    assert geotiff.read(DATA / "plain.tif").warnings == geotiff.read(DATA / "plain.tif").report == ()
    assert "read as metres" in " ".join(geotiff.read(DATA / "no_system.tif").warnings)
    assert "0.004 x value + -20" in " ".join(geotiff.read(DATA / "scaled.tif").report)
    assert "(ft)" in " ".join(geotiff.read(DATA / "unit_name.tif").report)


def test_zstd_without_its_package_is_a_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "zstandard", None)
    with pytest.raises(IcyMoonError, match=r"zstd\.tif.*ZSTD.*gdal_translate"):
        geotiff.read(DATA / "zstd.tif")


VALUES = np.array([[1.5, 20.0, 2.0], [3.0, 4.0, 5.0]], np.float32)
METADATA = '<GDALMetadata><Item name="SCALE" sample="0" role="scale">{}</Item>{}</GDALMetadata>'


def small(tmp_path: Path, **options) -> Path:
    return write_tiff(tmp_path / "a.tif", VALUES, **{"pixel": (2.0, 3.0), **options})


@pytest.mark.parametrize("mark", ["n/a", "none", "nan", "-3.4e38", "-inf", " 20 ", ""])
def test_any_text_may_mark_missing_heights(tmp_path, mark):
    read = geotiff.read(small(tmp_path, nodata=mark))
    assert np.isnan(read.heights_m).sum() == (mark == " 20 ")
    assert any("is not a number" in warning for warning in read.warnings) == (mark in ("n/a", "none"))


@pytest.mark.parametrize("sign", [1, -1])
def test_a_mark_is_that_number_and_no_height_beside_it(tmp_path, sign):
    """Heights above the centre of a moon are near a mark by a millionth of it."""
    values = (sign * np.array([[1737400.0, 1737400.125, 1737401.0], [1737399.0, 0.0, 1.0]])).astype(np.float32)
    path = write_tiff(tmp_path / "a.tif", values, pixel=(2.0, 3.0), nodata=str(sign * 1737400))
    # Two steps of float32, an eighth of a metre each, are allowed to a mark that was written with fewer digits.
    assert np.isnan(geotiff.read(path).heights_m).tolist() == [[True, True, False], [False, False, False]]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"metadata": METADATA.format("0", "")}, "scale of 0"),
        ({"metadata": METADATA.format("one", "")}, "'one'"),
        ({"metadata": METADATA.format("nan", "")}, "not a number"),
        ({"metadata": "<GDALMetadata><Item"}, "not a whole TIFF"),
        (
            {
                "keys": {4099: 9002},
                "metadata": METADATA.format(1, '<Item name="U" sample="0" role="unittype">m</Item>'),
            },
            "two units",
        ),
        ({"keys": {4099: 9999}}, "9999"),
        ({"keys": {4096: 1234}}, "1234"),
        ({"keys": {4096: 32767, 4099: 32767}}, r"whose unit a GeoTIFF cannot contain.*gdal_edit\.py -units m a\.tif$"),
        ({"pixel": (2.0, -3.0)}, "negative size.*gdal_translate"),
        ({"scale_z": 2.0}, "third number"),
        ({"matrix": (2.0, 0.1, 0, 0, 0.1, -3.0, 0, 0, *(0.0,) * 7, 1.0)}, "turned.*gdalwarp"),
        ({"extra": {274: (3,)}}, "reverse order.*first row on top"),
        ({"extra": {262: (3,)}}, "palette"),
    ],
    ids=str,
)
def test_contradictions_and_unknown_things_are_refused(tmp_path, options, words):
    with pytest.raises(IcyMoonError, match=words):
        geotiff.read(small(tmp_path, **options))


@pytest.mark.parametrize(
    ("keys", "metres"),
    [
        ({3076: 9001}, 1.0),
        ({3076: 9002}, 0.3048),
        ({3076: 9003}, SURVEY_FOOT_M),
        ({3076: 9036}, 1000.0),
        ({3072: 32633}, 1.0),
        ({3072: 32767}, 1.0),
        ({}, 1.0),
        ({3072: 2263}, None),
        ({3076: 32767}, None),
        ({3076: 9102}, None),
        ({1024: 3}, None),
    ],
    ids=str,
)
def test_the_unit_of_the_map(tmp_path, keys, metres):
    read = geotiff.read(small(tmp_path, keys=keys))
    assert read.pixel_m == (pytest.approx((2 * metres, 3 * metres)) if metres else None)
    assert bool(read.unplaced) == (metres is None)
    is_assumed = metres == 1.0 and (not keys or 32767 in keys.values())
    assert bool(read.warnings) == (is_assumed or metres not in (1.0, None))


@pytest.mark.parametrize(
    ("keys", "fix"),
    [
        ({3076: 9003}, r"gdal_edit\.py -units 'us-ft'"),
        ({3076: 9036}, "-units 'km'"),
        ({3076: 9030}, "write them in metres"),
        ({3076: 9001}, None),
        ({3076: 9003, 4099: 9003}, None),
        ({3076: 9003, 4099: 9001}, None),
    ],
    ids=str,
)
def test_heights_without_a_unit_on_a_map_that_is_not_in_metres_are_doubted(tmp_path, keys, fix):
    read = geotiff.read(small(tmp_path, keys=keys))
    found = [each for each in read.warnings if "no unit for its heights" in each]
    assert len(found) == (fix is not None)
    assert all(re.search(fix or "", each) for each in found)


def test_a_unit_that_is_named_counts_where_the_vertical_system_has_one_of_its_own(tmp_path):
    """As ``gdal_edit.py -units ft`` writes it, to which the refusal of such a file points."""
    named = METADATA.format(1, '<Item name="U" sample="0" role="unittype">ft</Item>')
    read = geotiff.read(small(tmp_path, keys={4096: 32767, 4099: 32767}, metadata=named))
    np.testing.assert_allclose(read.heights_m, VALUES * 0.3048)


def test_metadata_with_entities_is_not_unfolded(tmp_path):
    """Such a text may unfold to gigabytes; its scale is left out with the rest of it, or the file refused."""
    bomb = '<!DOCTYPE a [<!ENTITY b "bbbbbbbbbb"><!ENTITY c "&b;&b;&b;">]><GDALMetadata>&c;</GDALMetadata>'
    with pytest.raises(IcyMoonError, match="metadata"):
        geotiff.read(small(tmp_path, metadata=bomb))


@pytest.mark.parametrize("tag", [256, 257, 278, 322])
def test_sizes_beyond_reason_are_refused_before_memory_is_taken(tmp_path, tag):
    path = write_tiff(tmp_path / "a.tif", VALUES, tile=16 if tag == 322 else 0)
    data = bytearray(path.read_bytes())
    at = next(k for k in range(len(data) - 12, 8, -1) if data[k : k + 4] == tag.to_bytes(2, "little") + b"\4\0")
    data[at + 8 : at + 12] = (2**31).to_bytes(4, "little")
    path.write_bytes(data)
    if tag == 278:
        assert np.array_equal(geotiff.read(path).heights_m, VALUES)  # one strip of more rows than there are
        return
    with pytest.raises(IcyMoonError, match=r"a\.tif"):
        geotiff.read(path)


@pytest.mark.parametrize("tag", [256, 273, 279, 34735, 34736, 34737, 42112, 42113])
@pytest.mark.parametrize("kind", [2, 12, 16])
def test_a_tag_of_another_type_is_a_sentence(tmp_path, tag, kind):
    """As text, as fractions, or as numbers larger than any place in memory."""
    data = bytearray((DATA / "scaled.tif").read_bytes())
    start = int.from_bytes(data[4:8], "little")
    for at in range(start + 2, start + 2 + 12 * int.from_bytes(data[start : start + 2], "little"), 12):
        if int.from_bytes(data[at : at + 2], "little") == tag:
            data[at + 2 : at + 4] = kind.to_bytes(2, "little")
    (tmp_path / "b.tif").write_bytes(data)
    with contextlib.suppress(IcyMoonError):
        geotiff.read(tmp_path / "b.tif")


def test_directories_in_a_circle_end(tmp_path):
    data = bytearray(small(tmp_path).read_bytes())
    start = int.from_bytes(data[4:8], "little")
    end = start + 2 + 12 * int.from_bytes(data[start : start + 2], "little")
    data[end : end + 4] = start.to_bytes(4, "little")
    assert len(tiff.read_directories(ForeignBytes(bytes(data), len(data), Budget()))) == 1


def test_damage_anywhere_is_a_sentence_or_nothing(tmp_path):
    """Bytes changed at random: never another exception, whatever they say."""
    random = np.random.default_rng(8)
    sound = {name: (DATA / f"{name}.tif").read_bytes() for name in NAMES}
    for k in range(600):
        data = bytearray(sound[NAMES[k % len(NAMES)]])
        for place in random.integers(0, len(data), random.integers(1, 6)):
            data[place] = random.integers(0, 256)
        (tmp_path / "b.tif").write_bytes(data)
        with contextlib.suppress(IcyMoonError):
            assert not np.isinf(geotiff.read(tmp_path / "b.tif").heights_m).any()
