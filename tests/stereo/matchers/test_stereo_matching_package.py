"""The package stereo-matching in a Python of its own, with a stand-in of the same interface: the package and what it
needs take more than a gigabyte."""

import sys

import numpy as np
import pytest
from icymoon.stereo.matchers import check_options, match
from icymoon.stereo.matchers.resident_process import stop_residents
from icymoon.support.errors import IcyMoonError

#: torch.load as it is with weights_only: a file that contains "code" is refused, and without it runs.
TORCH = """
def load(path, map_location=None, weights_only=True):
    text = open(path).read()
    if text.startswith("code"):
        if weights_only:
            raise ValueError("Weights only load failed")
        open(text.split()[1], "w").close()
    return text
"""
#: What the package has in version 0.2.0, as far as it is used; its models read a checkpoint a second time with code.
PACKAGE = """
import torch
from types import SimpleNamespace as Namespace
class Model:
    @classmethod
    def from_pretrained(cls, path, device=None, variant="standard"):
        try:
            found = torch.load(path, map_location=device, weights_only=True)
        except Exception:
            found = torch.load(path, map_location=device, weights_only=False)
        model = cls()
        model.text = f"{found} {variant}"
        return model
class Config:
    @classmethod
    def from_variant(cls, name):
        config = cls()
        config.variant = {"raft-stereo-eth3d": "eth3d"}[name]
        return config
class Registry:
    def get_config_cls(self, name): return Config
    def get_model_cls(self, name): return Model
MODEL_REGISTRY = Registry()
class StereoProcessor:
    input_size = 384
    @classmethod
    def from_config(cls, config): return cls()
class StereoPipeline:
    def __init__(self, model, processor, device=None):
        self.model, self.processor, self.device = model, processor, device
    def __call__(self, left, right, colorize=True):
        assert not colorize and left.dtype.name == "uint8"
        height = self.processor.input_size
        width = left.shape[1] * height // left.shape[0]
        value = left.astype("float32").mean(axis=2) if self.model.text == "hub" else left[..., 0] * 0.0 + 3
        return Namespace(disparity=value, metadata={"input_resolution": (height, width), "text": self.model.text})
def pipeline(task, model=None, device=None):
    if model != "raft-stereo":
        raise RuntimeError(f"Could not download checkpoint for '{model}' from HuggingFace Hub.\\nHF repo: a/b")
    made = Model()
    made.text = "hub"
    return StereoPipeline(made, StereoProcessor(), device)
"""


@pytest.fixture(autouse=True)
def _package(tmp_path, monkeypatch):
    (tmp_path / "torch.py").write_text(TORCH, encoding="utf-8")
    (tmp_path / "stereo_matching.py").write_text(PACKAGE, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    yield
    stop_residents()


def run(**options):
    image = np.random.default_rng(0).integers(1, 256, (20, 30, 3)).astype(np.uint8)
    disparity, _, info = match(
        "stereo_matching", image, image, {"python": sys.executable, "model": "raft-stereo"} | options
    )
    return image, disparity, info["facts"]


def test_a_network_of_the_package_answers_and_the_size_that_it_ran_at_is_stated():
    image, disparity, facts = run()
    np.testing.assert_allclose(disparity, image.mean(axis=2), rtol=1e-6)
    assert facts["name"] == "raft-stereo"
    assert (facts["input_height"], facts["input_width"]) == (384, 576)
    assert (run(height=24)[2]["input_height"], run(height=24)[2]["input_width"]) == (24, 36)


def test_parameters_of_one_s_own_are_read_for_the_variant(tmp_path):
    (tmp_path / "mine.pth").write_text("numbers", encoding="utf-8")
    _, disparity, _ = run(model="raft-stereo-eth3d", checkpoint=str(tmp_path / "mine.pth"))
    assert (disparity == 3).all()


def test_a_checkpoint_with_code_is_refused_and_its_code_not_run(tmp_path):
    (tmp_path / "evil.pth").write_text(f"code {tmp_path / 'ran'}", encoding="utf-8")
    with pytest.raises(
        IcyMoonError,
        match=r"stereo_matching.model raft-stereo-eth3d ended with status 1 before it was "
        r"ready \(RuntimeError: .*evil.pth contains more than parameters, which may be code",
    ) as caught:
        run(model="raft-stereo-eth3d", checkpoint=str(tmp_path / "evil.pth"))
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "ran").exists()


def test_what_the_package_cannot_load_is_its_own_sentence():
    with pytest.raises(IcyMoonError, match=r"RuntimeError: Could not download checkpoint for 's2m2'.*HF repo: a/b"):
        run(model="s2m2")


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({}, "stereo_matching.python is empty"),
        ({"python": sys.executable}, "stereo_matching.model is empty"),
        ({"python": "/no/python", "model": "s2m2"}, "starts with /no/python, which is not a program"),
        ({"python": sys.executable, "model": "s2m2", "checkpoint": "/no/file"}, "names /no/file, which is not a file"),
    ],
)
def test_what_is_missing_is_refused_before_anything_else(options, reason):
    with pytest.raises(IcyMoonError, match=reason):
        check_options("stereo_matching", options)
