"""Training samples: what they contain, that workers and order change nothing, and that scenes are never split."""

from __future__ import annotations

from typing import Any

import numpy as np
import pairs
import pytest
from icymoon.formats.exr_parts import read_pieces
from icymoon.physics.random_numbers.seeds import make_generator
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.pairs.scene_splits import check_splits, choose_split, name_scene
from icymoon.settings.description import defaults, merged
from icymoon.stereo.torch_data import Dataset
from icymoon.support.errors import IcyMoonError

RIG = pairs.camera(96, 64)
SCENE = pairs.Scene(sky_rows=8)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Six pairs of three scenes, each under two suns."""
    root = tmp_path_factory.mktemp("set")
    for k in range(6):
        settings = merged(
            defaults(), {"dataset": {"seed": k // 2}, "light": {"sun_elevation_deg": 10.0 + 30 * (k % 2)}}
        )
        pairs.write_pair(root / "pairs" / f"{k:012x}", SCENE, RIG, settings=settings)
    return root


def alike(one, other) -> bool:
    return all(np.array_equal(one[key], other[key]) for key in one)


def test_a_sample_is_the_pair_in_units(dataset):
    found = Dataset(dataset).arrays(0)
    depth = pairs.view(SCENE, RIG, "left")[0]
    assert found["left"].shape == (1, 64, 96)
    assert found["left"].dtype == found["disparity_px"].dtype == np.float32
    assert 0 <= found["left"].min() < found["left"].max() <= 1
    assert (found["valid"] == np.isfinite(depth)).all()
    assert found["disparity_px"][found["valid"]] == pytest.approx(RIG.disparity(depth[np.isfinite(depth)]), rel=1e-6)
    assert not found["disparity_px"][~found["valid"]].any()
    assert found["occluded"][:, :3][found["valid"][:, :3]].all(), "at the left edge nothing is in the right image"
    assert found["focal_px"] == RIG.focal_px


def test_a_crop_is_a_part_of_the_whole(dataset):
    whole, crop = Dataset(dataset).arrays(3), Dataset(dataset, crop_px=(40, 24)).arrays(3)
    left, upper = round(RIG.cx_px - crop["cx_px"]), round(RIG.cy_px - crop["cy_px"])
    assert crop["disparity_px"].shape == (24, 40)
    assert np.array_equal(crop["disparity_px"], whole["disparity_px"][upper : upper + 24, left : left + 40])
    corners = {(Dataset(dataset, crop_px=(40, 24)).arrays(k)["cx_px"]) for k in range(6)}
    assert len(corners) > 1


def test_range_points_are_marked_at_their_pixels_anew_in_every_epoch(dataset):
    plain, ranged = Dataset(dataset), Dataset(dataset, lidar={"points": 40, "noise_cm": 0})
    whole = ranged.arrays(1)
    marked = whole.pop("range_disparity_px")
    assert alike(plain.arrays(1), whole), "points change nothing else"
    assert marked.dtype == np.float32
    assert np.count_nonzero(marked) == 40
    there = marked > 0
    assert whole["valid"][there].all()
    assert marked[there] == pytest.approx(whole["disparity_px"][there], rel=1e-6)
    assert np.array_equal(marked, ranged.arrays(1)["range_disparity_px"])
    ranged.set_epoch(1)
    assert not np.array_equal(marked, ranged.arrays(1)["range_disparity_px"])
    crop = Dataset(dataset, lidar={"points": 40, "noise_cm": 0}, crop_px=(40, 24)).arrays(1)
    left, upper = round(RIG.cx_px - crop["cx_px"]), round(RIG.cy_px - crop["cy_px"])
    assert np.array_equal(crop["range_disparity_px"], marked[upper : upper + 24, left : left + 40])
    with pytest.raises(IcyMoonError, match="point"):
        Dataset(dataset, lidar={"poins": 40})


def test_samples_depend_on_seed_and_epoch_alone(dataset):
    options: Any = {"augment": {"sensor.read_noise_e": (5.0, 50.0)}, "crop_px": (40, 24)}
    one, two = Dataset(dataset, **options), Dataset(dataset, **options)
    two.arrays(5)  # another order
    assert alike(one.arrays(2), two.arrays(2))
    other = Dataset(dataset, **options, seed=1)
    two.set_epoch(1)
    for changed in (other, two):
        assert not np.array_equal(one.arrays(2)["left"], changed.arrays(2)["left"])
    two.set_epoch(0)
    assert alike(one.arrays(2), two.arrays(2))


def test_a_scene_is_in_one_split_and_stays_there(dataset):
    splits = {"train": 0.5, "test": 0.5}
    found = {}
    for name in splits:
        try:
            found[name] = Dataset(dataset, name, splits=splits).pairs
        except IcyMoonError:
            found[name] = []
    scenes = {name: {name_scene(pair) for pair in found[name]} for name in splits}
    assert not scenes["train"] & scenes["test"]
    assert sum(map(len, found.values())) == 6
    assert len(scenes["train"] | scenes["test"]) == 3, "another Sun makes no other scene, another seed does"


def test_shares_are_those_of_many_scenes():
    splits = check_splits({"train": 0.8, "val": 0.15, "test": 0.05})
    drawn = [choose_split(f"{k:012x}", splits) for k in range(2000)]
    # Five standard deviations of 2000 draws.
    for name, share in splits.items():
        assert abs(drawn.count(name) / 2000 - share) < 5 * (share * (1 - share) / 2000) ** 0.5
    for wrong in ({}, {"train": 0.5}, {"a": 1.5, "b": -0.5}):
        with pytest.raises(IcyMoonError, match="share of the scenes"):
            check_splits(wrong)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"split": "trian"}, "train"),
        ({"augment": {"rig.baseline_m": (1, 2)}}, "new render"),
        ({"augment": {"sensor.read_noise": (1, 2)}}, "read_noise_e"),
        ({"crop_px": (1000, 10)}, "smaller"),
    ],
)
def test_what_cannot_be_is_refused_before_training(dataset, options, words):
    with pytest.raises(IcyMoonError, match=words):
        Dataset(dataset, **options)


@pytest.mark.heavy
def test_a_loader_with_workers_gives_the_same_tensors(dataset):
    torch = pytest.importorskip("torch")
    import icymoon

    data = icymoon.torch.Dataset(dataset, crop_px=(32, 32), augment={"sensor.gain": (1.0, 2.0)})
    here = list(torch.utils.data.DataLoader(data, batch_size=2))
    there = list(torch.utils.data.DataLoader(data, batch_size=2, num_workers=2))
    assert here[0]["left"].shape == (2, 1, 32, 32)
    assert here[0]["occluded"].dtype == torch.bool
    for one, other in zip(here, there, strict=True):
        assert all(
            torch.equal(one[key], other[key]) if torch.is_tensor(one[key]) else one[key] == other[key] for key in one
        )
    assert read_pair(data.pairs[0].folder).id == here[0]["pair"][0]


#: A camera without noise, whose crops can be compared with the whole image.
CLEAN_SENSOR = {"shot_noise": False, "read_noise_e": 0.0}


@pytest.mark.parametrize(
    "sensor",
    [
        {},
        {"auto_exposure": False, "exposure_s": 0.02},
        {"psf_sigma_px": 1.0},
        {"veiling_glare": 0.1, "prnu": 0.01},
        {"colour": "BAYER"},
    ],
    ids=str,
)
@pytest.mark.parametrize("layout", ["4.x", "4.x view", "5.x"])
def test_a_crop_shows_what_the_whole_shows_there(layout, sensor, tmp_path):
    settings = merged(defaults(), {"sensor": {**CLEAN_SENSOR, **sensor}, "light": {"planet_scale": 2.0}})
    pairs.write_pair(tmp_path / "pairs" / "0123456789ab", SCENE, RIG, layout, settings=settings, planet_share=0.3)
    whole, crops = Dataset(tmp_path).arrays(0), Dataset(tmp_path, crop_px=(30, 20))
    for epoch in range(4):
        crops.set_epoch(epoch)
        found = crops.arrays(0)
        left, upper = round(RIG.cx_px - found["cx_px"]), round(RIG.cy_px - found["cy_px"])
        window = (..., slice(upper, upper + 20), slice(left, left + 30))
        for key in ("left", "right", "disparity_px", "valid", "occluded"):
            assert np.array_equal(found[key], whole[key][window]), key


def test_a_crop_decodes_only_its_own_rows(tmp_path):
    """A chunk of other rows that is damaged is not noticed; that of its own rows is."""
    rig = pairs.camera(64, 96)  # six chunks of 16 rows
    settings = merged(defaults(), {"sensor": {"auto_exposure": False, "exposure_s": 0.02}})
    folder = pairs.write_pair(tmp_path / "pairs" / "0123456789ab", pairs.Scene(), rig, settings=settings)
    file = folder / "left.exr"
    data = bytearray(file.read_bytes())
    for piece in read_pieces(bytes(data)):
        at = data.find(piece.chunks[5])
        data[at + 8 : at + len(piece.chunks[5])] = bytes(len(piece.chunks[5]) - 8)
    file.write_bytes(data)
    crops, seen = Dataset(tmp_path, crop_px=(32, 16)), set()
    for epoch in range(12):
        crops.set_epoch(epoch)
        upper = round(rig.cy_px - generator_row(crops, rig))
        seen.add(upper + 16 > 80)
        if upper + 16 > 80:
            with pytest.raises(IcyMoonError, match=r"left\.exr"):
                crops.arrays(0)
        else:
            assert crops.arrays(0)["left"].shape == (1, 16, 32)
    assert seen == {True, False}


def generator_row(crops, rig):
    """The principal row that the sample of this epoch will state."""
    random = make_generator(0, "training", crops._epoch, int(crops.pairs[0].id, 16))
    random.integers(2**31 - 1)
    return rig.cy_px - crops._draw_window(crops.pairs[0], random)[3]


def test_light_of_the_planet_is_weighed_in_samples(tmp_path):
    for k, scale in enumerate((1.0, 3.0)):
        settings = merged(
            defaults(),
            {"light": {"planet_scale": scale}, "sensor": {**CLEAN_SENSOR, "auto_exposure": False, "exposure_s": 1e-6}},
        )
        pairs.write_pair(tmp_path / "pairs" / f"{k:012x}", SCENE, RIG, settings=settings, planet_share=0.5)
    one, three = (Dataset(tmp_path).arrays(k)["left"] for k in range(2))
    assert 0.1 < three.max() < 1.0
    assert three.mean() / one.mean() == pytest.approx(2.0, rel=0.02)  # half of the light is three times as strong
