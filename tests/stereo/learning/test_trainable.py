"""Other networks and other samples in training: IGEV, DSMNet, a user's own, and pairs of data sets."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pairs
import pytest
import torch
from icymoon.settings.description import defaults, merged
from icymoon.stereo import training_data
from icymoon.stereo.learning.made_pairs import CROPS_PER_GROUND, MadePairs
from icymoon.stereo.learning.train import CachedGrounds, Plan, Run
from icymoon.stereo.learning.trainable import find_trainable
from icymoon.stereo.training_data import MADE, open_sources
from icymoon.support.errors import IcyMoonError
from torch import nn

PLAN = Plan(steps=3, batch=2, crop_px=(64, 32), pair_px=(64, 48), ranges_px=(16,), warm_up=1, steps_per_ground=2)
OWN = """
import torch

class Net(torch.nn.Module):
    def __init__(self, range_px):
        super().__init__()
        self.conv, self.range_px = torch.nn.Conv2d(2, 1, 5, padding=2), range_px

    def forward(self, left, right):
        return self.range_px * torch.sigmoid(self.conv(torch.cat([left, right], 1)))[:, 0]

def flat(range_px):
    net = Net(range_px)
    net.forward = lambda left, right: torch.zeros(3, 3)
    return net
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    (tmp_path / "my_network_to_train.py").write_text(OWN, "utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield "my_network_to_train:Net"
    sys.modules.pop("my_network_to_train", None)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    root = tmp_path_factory.mktemp("set")
    for k in range(3):
        settings = merged(defaults(), {"dataset": {"seed": k}})
        pairs.write_pair(root / "pairs" / f"{k:012x}", pairs.Scene(), pairs.camera(96, 64), settings=settings)
    (root / "plan.toml").write_text("", "utf-8")
    return root


@pytest.fixture
def grounds(dataset, monkeypatch):
    monkeypatch.setattr(training_data, "Dataset", lambda *words, **given: _all_pairs(*words, **given))
    return CachedGrounds(open_sources([str(dataset)], PLAN.pair_px, 0))


def _all_pairs(folder, split, **given):
    from icymoon.stereo.torch_data import Dataset

    assert split == "train"
    return Dataset(folder, **given)  # three scenes may leave the split empty


def weights(run) -> np.ndarray:
    return torch.cat([each.flatten() for each in run.network.state_dict().values()]).numpy()


def test_a_users_own_network_trains_is_saved_and_is_fine_tuned(own, grounds, tmp_path):
    run = Run(PLAN, tmp_path / "run", grounds, find_trainable(own))
    before = weights(run)
    rows = list(run.iterate())
    run.finish()
    assert (weights(run) != before).all()
    assert rows[0]["levels"] == rows[0]["confidence"] == 0.0
    assert not (tmp_path / "run" / "weights.onnx").exists()  # only icynet has no fixed sizes
    tuned = Run(PLAN, tmp_path / "tuned", grounds, find_trainable(own))
    tuned.start_from(tmp_path / "run" / "weights.safetensors")
    assert np.array_equal(weights(tuned), weights(run))
    with pytest.raises(IcyMoonError, match="is not a checkpoint of icynet"):
        Run(PLAN, tmp_path / "other", grounds).start_from(tmp_path / "run" / "weights.safetensors")


def test_pairs_of_a_data_set_come_all_before_one_comes_again(grounds, dataset, tmp_path):
    samples = list(open_sources([str(dataset)], PLAN.pair_px, 0).list_ground(0))
    scenes = [each["scene"] for each in samples]
    assert len(scenes) == CROPS_PER_GROUND  # a ground made by rays and a group of pairs weigh the same
    assert len(set(scenes[:12])) == 3
    assert scenes[:12] == scenes[12:]  # three pairs, twice
    found = grounds.read(0)
    assert found["left"].shape == (24, 1, 48, 64)
    assert len({each.tobytes() for each in found["left"]}) == 24  # other crops, and other noise
    assert not np.array_equal(grounds.read(1)["left"], found["left"])


def test_sources_take_turns(dataset, monkeypatch):
    monkeypatch.setattr(training_data, "Dataset", _all_pairs)
    both = open_sources([MADE, str(dataset)], (64, 48), 5)
    assert both.name == f"train-5+{dataset.name}-5"
    alone = open_sources([str(dataset)], (64, 48), 5)
    for number in range(2):
        one, other = (next(iter(each)) for each in (both.list_ground(2 * number + 1), alone.list_ground(number)))
        assert np.array_equal(one["left"], other["left"])


def test_grounds_of_a_file_of_settings_and_those_that_rays_cannot_make(tmp_path):
    file = tmp_path / "moon.toml"
    file.write_text('[preset]\ninclude = ["scenes/europa_penitentes"]\n[rocks]\ncoverage = 0.1\n', "utf-8")
    source = open_sources([f"made:{file}"], (64, 48), 5)
    assert isinstance(source, MadePairs)
    own = source.variety.own
    assert own is not None
    assert (own.penitentes.height_m, own.rocks.coverage) == (2.0, 0.1)
    for text, words in (
        ('[source]\nkind = "HEIGHT_MAP"\n', "procedural ground only; give another file, or render"),
        ("[terrain]\nnothing = 1\n", "nothing"),
    ):
        file.write_text(text, "utf-8")
        with pytest.raises(IcyMoonError, match=words):
            open_sources([f"made:{file}"], (64, 48), 5)
    with pytest.raises(IcyMoonError, match="europa_penitentes"):
        open_sources(["made:scenes/europa_penitente"], (64, 48), 5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nothing", "Unknown matcher 'nothing'"),
        ("sgbm", "has no network to train"),
        ("no_such_module_here:Net", "cannot be loaded"),
        ("my_network_to_train:Other", "cannot be loaded"),
    ],
)
def test_what_is_no_network_is_a_sentence(own, text, words):
    with pytest.raises(IcyMoonError, match=words):
        find_trainable(text)


def test_another_shape_of_a_users_network_and_a_source_that_comes_twice_are_sentences(own, grounds, tmp_path):
    run = Run(PLAN, tmp_path, grounds, find_trainable("my_network_to_train:flat"))
    with pytest.raises(IcyMoonError, match=r"disparity of shape \(3, 3\)"):
        next(run.iterate())
    with pytest.raises(IcyMoonError, match="comes twice"):
        open_sources([MADE, MADE], (64, 48), 0)


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("name", "rate"), [("igev", 2e-4), ("dsmnet", 1e-3)])
def test_the_papers_networks_train(name, rate, grounds, tmp_path):
    plan = replace(PLAN, crop_px=(192, 128), pair_px=(192, 128), ranges_px=(64,), steps=1, batch=1, rate=rate)
    rows = list(Run(plan, tmp_path, CachedGrounds(_Larger()), find_trainable(name)).iterate())
    assert all(np.isfinite(row["loss"]) for row in rows)


class _Larger:
    """Noise that is moved by 4 px."""

    name = "noise"

    def list_ground(self, number):
        random = np.random.default_rng(number).random((1, 128, 200), np.float32)
        yes = np.ones((128, 192), bool)
        yield {
            "left": random[..., 4:196],
            "right": random[..., 8:],
            "disparity_px": np.full((128, 192), 4, np.float32),
            "valid": yes,
            "occluded": ~yes,
        }


def test_modules_are_networks(own):
    assert isinstance(find_trainable(own).make(16), nn.Module)
