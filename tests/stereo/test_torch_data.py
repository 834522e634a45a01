"""Training samples: what they contain, that workers and order change nothing, and that scenes are never split."""

from __future__ import annotations

from typing import Any

import numpy as np
import pairs
import pytest
from icymoon.errors import IcyMoonError
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.pairs.scene_splits import check_splits, scene_of, split_of
from icymoon.settings.description import defaults, merged
from icymoon.stereo.torch_data import Dataset

RIG = pairs.camera(96, 64)
SCENE = pairs.Scene(sky_rows=8)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Six pairs of three scenes, each under two suns."""
    root = tmp_path_factory.mktemp("set")
    for k in range(6):
        settings = merged(defaults(), {"dataset": {"seed": k // 2},
                                       "light": {"sun_elevation_deg": 10.0 + 30 * (k % 2)}})
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
    assert np.array_equal(crop["disparity_px"], whole["disparity_px"][upper:upper + 24, left:left + 40])
    corners = {(Dataset(dataset, crop_px=(40, 24)).arrays(k)["cx_px"]) for k in range(6)}
    assert len(corners) > 1


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
    scenes = {name: {scene_of(pair) for pair in found[name]} for name in splits}
    assert not scenes["train"] & scenes["test"]
    assert sum(map(len, found.values())) == 6
    assert len(scenes["train"] | scenes["test"]) == 3, "another Sun makes no other scene, another seed does"


def test_shares_are_those_of_many_scenes():
    splits = check_splits({"train": 0.8, "val": 0.15, "test": 0.05})
    drawn = [split_of(f"{k:012x}", splits) for k in range(2000)]
    # Five standard deviations of 2000 draws.
    for name, share in splits.items():
        assert abs(drawn.count(name) / 2000 - share) < 5 * (share * (1 - share) / 2000) ** 0.5
    for wrong in ({}, {"train": 0.5}, {"a": 1.5, "b": -0.5}):
        with pytest.raises(IcyMoonError, match="share of the scenes"):
            check_splits(wrong)


@pytest.mark.parametrize(("options", "words"), [
    ({"split": "trian"}, "train"), ({"augment": {"rig.baseline_m": (1, 2)}}, "new render"),
    ({"augment": {"sensor.read_noise": (1, 2)}}, "read_noise_e"), ({"crop_px": (1000, 10)}, "smaller")])
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
        assert all(torch.equal(one[key], other[key]) if torch.is_tensor(one[key]) else one[key] == other[key]
                   for key in one)
    assert read_pair(data.pairs[0].folder).id == here[0]["pair"][0]
