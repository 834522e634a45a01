"""Light added in EXR files, against files that an EXR library wrote, and read by it again."""

from __future__ import annotations

from functools import partial

import numpy as np
import OpenEXR
import pytest
from icymoon.formats.exr_add import add_baked, add_group, is_sum_of_lights, measure_baked_noise
from icymoon.formats.exr_layout import is_whole
from icymoon.formats.exr_parts import Piece, assemble, join_layers, keep_part_attributes, read_pieces
from icymoon.formats.exr_pixels import Pixels, compress, drop_passes, encode_part
from icymoon.stereo.images.exr import read_light
from icymoon.support.arrays import Array

LIGHT = ("Combined", "Combined_Sun", "Combined_Planet")


def write(path, passes: dict[str, Array], several: bool, compression) -> None:
    """A file as Blender 5 writes it, a part for each pass, or as Blender 4 does, with one part."""
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    channels = {
        name: {
            f"{name}.{band}": np.ascontiguousarray(values[..., k]) for k, band in enumerate("RGBA"[: values.shape[-1]])
        }
        for name, values in passes.items()
    }
    parts = (
        [OpenEXR.Part(dict(header), found, name) for name, found in channels.items()]
        if several
        else [OpenEXR.Part(dict(header), {k: v for found in channels.values() for k, v in found.items()}, "a")]
    )
    OpenEXR.File(parts).write(str(path))


def pieces_of(path) -> list[Piece]:
    return read_pieces(path.read_bytes())


def read(path) -> dict[str, Array]:
    file = OpenEXR.File(str(path), separate_channels=True)
    return {name: channel.pixels for part in file.parts for name, channel in part.channels.items()}


@pytest.mark.parametrize("compression", [OpenEXR.NO_COMPRESSION, OpenEXR.ZIPS_COMPRESSION, OpenEXR.ZIP_COMPRESSION])
@pytest.mark.parametrize("several", [True, False])
@pytest.mark.parametrize("height", [1, 16, 53])
def test_parts_are_joined_and_light_is_added(tmp_path, several, compression, height):
    random = np.random.default_rng(height)

    def image(scale: float) -> Array:
        values = (random.random((height, 31, 3)) * scale).astype(np.float32)
        values[:, 20:] = values[:1, 20:]  # something that shrinks when it is compressed
        return values

    sun, planet, ice, normal = image(10.0), image(0.1), image(0.2), image(1.0)
    write(
        tmp_path / "view.exr",
        {"Beauty.Combined": sun + planet, "Beauty.Combined_Sun": sun, "Beauty.Combined_Planet": planet},
        several,
        compression,
    )
    write(tmp_path / "planet.exr", {"Beauty.Combined": ice, "Beauty.Combined_Planet": ice}, several, compression)
    write(tmp_path / "truth.exr", {"Truth.Normal": normal}, several, compression)
    view, light, truth = (pieces_of(tmp_path / f"{name}.exr") for name in ("view", "planet", "truth"))
    (tmp_path / "view.exr").write_bytes(join_layers({"Beauty": add_group(view, light, "Planet"), "Truth": truth}))
    assert is_whole(tmp_path / "view.exr")
    found = read(tmp_path / "view.exr")
    for k, band in enumerate("RGB"):
        assert np.array_equal(found[f"Truth.Normal.{band}"], normal[..., k])
        assert np.array_equal(found[f"Beauty.Combined.{band}"], (sun + planet + ice)[..., k])
        assert np.array_equal(found[f"Beauty.Combined_Planet.{band}"], (planet + ice)[..., k])
        assert np.array_equal(found[f"Beauty.Combined_Sun.{band}"], sun[..., k])
    stored = read_light(tmp_path / "view.exr")
    assert np.allclose(sum(stored.groups.values()), stored.radiance, rtol=1e-5)


@pytest.mark.parametrize("compression", [OpenEXR.NO_COMPRESSION, OpenEXR.ZIPS_COMPRESSION, OpenEXR.ZIP_COMPRESSION])
@pytest.mark.parametrize("several", [True, False])
@pytest.mark.parametrize("height", [1, 16, 53])
def test_passes_that_nobody_needs_are_left_out(tmp_path, several, compression, height):
    random = np.random.default_rng(height)
    made = {
        name: random.random((height, 31, 3)).astype(np.float32)
        for name in ("Truth.Combined", "Truth.Combined_Sun", "Truth.Normal", "Truth.Depth")
    }
    write(tmp_path / "truth.exr", made, several, compression)
    data = (tmp_path / "truth.exr").read_bytes()
    for unwanted, kept in (({"Truth.Combined"}, 3), ({"Truth.Combined", "Truth.Combined_Sun"}, 2), ({"Truth.Comb"}, 4)):
        less = partial(drop_passes, unwanted=unwanted)
        (tmp_path / "less.exr").write_bytes(join_layers({"Truth": read_pieces(data)}, less))
        assert is_whole(tmp_path / "less.exr")
        found = read(tmp_path / "less.exr")
        assert {name.rpartition(".")[0] for name in found} == made.keys() - unwanted
        for name, values in found.items():
            assert np.array_equal(values, made[name.rpartition(".")[0]][..., "RGB".index(name[-1])])
        # Random numbers do not shrink: what is left is in proportion.
        assert len(found) == 3 * kept
        assert len((tmp_path / "less.exr").read_bytes()) < len(data) * kept / 4 * 1.05 + 2000


@pytest.mark.parametrize("several", [True, False])
@pytest.mark.parametrize("height", [1, 16, 53])
def test_a_file_without_compression_is_compressed_and_has_the_same_values(tmp_path, several, height):
    ramp = np.broadcast_to(np.linspace(0, 1, 31, dtype=np.float32)[:, None], (height, 31, 3))
    passes = {"Beauty.Combined": ramp, "Beauty.Combined_Sun": 2 * ramp}
    sizes = {}
    for compression in (OpenEXR.NO_COMPRESSION, OpenEXR.ZIPS_COMPRESSION):
        write(tmp_path / "view.exr", passes, several, compression)
        before = (tmp_path / "view.exr").read_bytes()
        (tmp_path / "view.exr").write_bytes(join_layers({"Beauty": read_pieces(before)}, compress))
        assert is_whole(tmp_path / "view.exr")
        file = OpenEXR.File(str(tmp_path / "view.exr"))
        sizes[compression] = (
            {part.compression() for part in file.parts},
            len(before),
            len((tmp_path / "view.exr").read_bytes()),
        )
        found = read(tmp_path / "view.exr")
        for name, values in passes.items():
            assert all(np.array_equal(found[f"{name}.{band}"], values[..., k]) for k, band in enumerate("RGB"))
    kinds, before, after = sizes[OpenEXR.NO_COMPRESSION]
    assert kinds == {OpenEXR.ZIP_COMPRESSION}
    assert after < before - 0.5 * height * 31 * 24
    assert sizes[OpenEXR.ZIPS_COMPRESSION][0] == {OpenEXR.ZIPS_COMPRESSION}  # stays as it is


def test_a_line_of_another_size_is_refused(tmp_path):
    write(tmp_path / "view.exr", {"Beauty.Combined": np.ones((5, 4, 3), np.float32)}, True, OpenEXR.NO_COMPRESSION)
    (piece,) = read_pieces((tmp_path / "view.exr").read_bytes())
    piece.chunks[2] = piece.chunks[2][:-4]
    with pytest.raises(ValueError, match="the wrong size"):
        Pixels(piece).decode()


def test_a_layer_of_nothing_else_is_left_out_and_what_is_not_understood_stays(tmp_path):
    values = np.ones((5, 7, 3), np.float32)
    write(tmp_path / "a.exr", {"Truth.Combined": values}, False, OpenEXR.ZIP_COMPRESSION)
    write(tmp_path / "b.exr", {"Truth.Combined": values, "Truth.Depth": values}, False, OpenEXR.PIZ_COMPRESSION)
    a, b = (pieces_of(tmp_path / name) for name in ("a.exr", "b.exr"))
    less = partial(drop_passes, unwanted={"Truth.Combined"})
    assert [piece.name for piece in read_pieces(join_layers({"A": a, "B": b}, less))] == ["a"]
    (tmp_path / "less.exr").write_bytes(join_layers({"A": a, "B": b}, less))
    assert len(read(tmp_path / "less.exr")) == 6


def test_what_cannot_be_added_is_refused(tmp_path):
    values = np.zeros((4, 4, 3), np.float32)
    write(tmp_path / "view.exr", {"Beauty.Combined": values}, True, OpenEXR.ZIP_COMPRESSION)
    write(tmp_path / "planet.exr", {"Beauty.Combined_Planet": values}, True, OpenEXR.ZIP_COMPRESSION)
    view, planet = (pieces_of(tmp_path / f"{name}.exr") for name in ("view", "planet"))
    with pytest.raises(KeyError):  # it has no planet's group
        add_group(view, planet, "Planet")


@pytest.mark.parametrize("compression", [OpenEXR.NO_COMPRESSION, OpenEXR.ZIP_COMPRESSION])
@pytest.mark.parametrize("several", [True, False])
@pytest.mark.parametrize("height", [1, 53])
def test_a_pass_is_added_beside_others(tmp_path, several, compression, height):
    random = np.random.default_rng(height)
    normal, hidden = (random.random((height, 31, count)).astype(np.float32) for count in (3, 1))
    write(tmp_path / "truth.exr", {"Truth.Normal": normal}, several, compression)
    pieces = [keep_part_attributes(piece, "Truth") for piece in read_pieces((tmp_path / "truth.exr").read_bytes())]
    added = Pixels(pieces[0]).replace_channels("Truth.Hidden", ("X",), hidden.transpose(0, 2, 1))
    (tmp_path / "both.exr").write_bytes(assemble([*pieces, added]))
    assert is_whole(tmp_path / "both.exr")
    found = read(tmp_path / "both.exr")
    assert np.array_equal(found["Truth.Hidden.X"], hidden[..., 0])
    assert np.array_equal(found["Truth.Normal.G"], normal[..., 1])


@pytest.mark.parametrize("several", [True, False])
def test_baked_light_is_added_to_the_image_and_its_share_is_known(tmp_path, several):
    random = np.random.default_rng(3)
    direct, baked, other = ((random.random((20, 31, 3)) * scale).astype(np.float32) for scale in (10.0, 3.0, 1.0))
    write(
        tmp_path / "view.exr",
        {"Beauty.Combined": direct, "Beauty.Baked": baked, "Beauty.Depth": other},
        several,
        OpenEXR.ZIP_COMPRESSION,
    )
    added, shares = add_baked(pieces_of(tmp_path / "view.exr"))
    assert shares == {"Sun": pytest.approx(baked.sum() / (direct + baked).sum(), rel=1e-6)}
    (tmp_path / "view.exr").write_bytes(join_layers({"Beauty": added}, partial(drop_passes, unwanted={"Beauty.Baked"})))
    found = read(tmp_path / "view.exr")
    for k, band in enumerate("RGB"):
        assert np.array_equal(found[f"Beauty.Combined.{band}"], (direct + baked)[..., k])
        assert np.array_equal(found[f"Beauty.Depth.{band}"], other[..., k])
    assert not any("Baked" in name for name in found)
    with pytest.raises(KeyError):
        add_baked(pieces_of(tmp_path / "view.exr"))


def test_a_pixel_without_baked_light_makes_the_share_unknown(tmp_path):
    direct = np.ones((4, 5, 3), np.float32)
    baked = direct.copy()
    baked[2, 3] = -1e20
    write(tmp_path / "view.exr", {"Beauty.Combined": direct, "Beauty.Baked": baked}, True, OpenEXR.ZIP_COMPRESSION)
    before = pieces_of(tmp_path / "view.exr")
    added, shares = add_baked(before)
    assert np.isnan(shares["Sun"])
    assert added == before


@pytest.mark.parametrize("several", [True, False])
def test_baked_light_of_sun_and_planet_is_added_to_the_light_groups_too(tmp_path, several):
    random = np.random.default_rng(4)
    sun, planet, by_sun, by_planet = (
        (random.random((20, 31, 3)) * scale).astype(np.float32) for scale in (10.0, 0.1, 2.0, 0.02)
    )
    write(
        tmp_path / "view.exr",
        {
            "Beauty.Combined": sun + planet,
            "Beauty.Combined_Sun": sun,
            "Beauty.Combined_Planet": planet,
            "Beauty.Baked": by_sun,
            "Beauty.BakedPlanet": by_planet,
        },
        several,
        OpenEXR.ZIP_COMPRESSION,
    )
    added, shares = add_baked(pieces_of(tmp_path / "view.exr"))
    total = sun.sum() + planet.sum() + by_sun.sum() + by_planet.sum()
    assert shares == {
        "Sun": pytest.approx(by_sun.sum() / total, rel=1e-5),
        "Planet": pytest.approx(by_planet.sum() / total, rel=1e-5),
    }
    (tmp_path / "view.exr").write_bytes(join_layers({"Beauty": added}))
    light = read_light(tmp_path / "view.exr")
    assert np.array_equal(light.groups["Sun"], sun + by_sun)
    assert np.array_equal(light.groups["Planet"], planet + by_planet)
    assert np.allclose(light.groups["Sun"] + light.groups["Planet"], light.radiance, rtol=1e-6)


@pytest.mark.parametrize("several", [True, False])
def test_the_noise_of_baked_light_is_that_of_the_pixels_that_have_it(tmp_path, several):
    random = np.random.default_rng(5)
    direct, baked, planet = (random.random((20, 31, 3), np.float32) * np.float32(scale) for scale in (10.0, 3.0, 1.0))
    error, other = (random.standard_normal((20, 31, 1)).astype(np.float32) * np.float32(scale) for scale in (0.3, 0.1))
    baked[:5], planet[:5] = 0, 0  # sky
    write(
        tmp_path / "view.exr",
        {
            "Beauty.Combined": np.concatenate([direct, np.ones_like(direct[..., :1])], axis=-1),  # with alpha
            "Beauty.Baked": baked,
            "Beauty.BakedPlanet": planet,
        },
        several,
        OpenEXR.ZIP_COMPRESSION,
    )
    errors = (("BakedError", error), ("BakedErrorPlanet", other))
    pieces, _ = add_baked(pieces_of(tmp_path / "view.exr"))
    pieces += [encode_part(f"Beauty.{name}", {"X": values[..., 0]}) for name, values in errors]
    light = (direct + baked + planet)[5:].astype(np.float64)
    both = (error.astype(np.float64) + other)[5:]
    assert measure_baked_noise(pieces) == pytest.approx(np.sqrt(np.mean(both**2)) / light.mean(), rel=1e-6)


def test_an_image_without_baked_light_has_no_noise_of_it(tmp_path):
    direct = np.ones((4, 5, 3), np.float32)
    write(tmp_path / "view.exr", {"Beauty.Combined": direct, "Beauty.Baked": 0 * direct}, True, OpenEXR.ZIP_COMPRESSION)
    assert measure_baked_noise(pieces_of(tmp_path / "view.exr")) is None


@pytest.mark.parametrize("several", [True, False])
def test_an_image_is_the_sum_of_its_lights_or_not(tmp_path, several):
    random = np.random.default_rng(3)
    sun, planet = (random.random((20, 31, 3), np.float32) * scale for scale in (np.float32(40), np.float32(0.01)))
    lights = {"Beauty.Combined_Sun": sun, "Beauty.Combined_Planet": planet}
    denoised, unknown, dark = sun + planet, sun + planet, sun + planet
    denoised[3, 4, 1] *= np.float32(1 + 2.0**-18)
    unknown[3, 4, 1] = np.nan
    dark[:] = 0
    cases = {
        "rounded": (lights | {"Beauty.Combined": (sun + planet) * np.float32(1 + 2.0**-22)}, True),
        "denoised": (lights | {"Beauty.Combined": denoised}, False),
        "unknown": (lights | {"Beauty.Combined": unknown}, False),
        "dark": (lights | {"Beauty.Combined": dark}, False),
        "one light": ({"Beauty.Combined": sun}, False),
        "no image": (lights, False),
    }
    for name, (passes, is_sum) in cases.items():
        write(tmp_path / "view.exr", passes, several, OpenEXR.ZIP_COMPRESSION)
        assert is_sum_of_lights(pieces_of(tmp_path / "view.exr")) is is_sum, name


def test_an_image_of_a_kind_that_is_not_read_is_no_sum(tmp_path):
    values = np.ones((20, 31, 3), np.float32)
    write(tmp_path / "view.exr", {"Beauty.Combined": values}, True, OpenEXR.PIZ_COMPRESSION)
    assert not is_sum_of_lights(pieces_of(tmp_path / "view.exr"))
