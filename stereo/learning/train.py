"""Training of a stereo network: steps, checkpoints from which the same run continues, and a log.

The seed and the step's number determine all randomness of a step. So a run that was stopped and resumed has the same
losses as an uninterrupted one. Grounds come one after the other; at each step, the newest ``window`` grounds are used.
"""

from __future__ import annotations

import csv
import io
import math
import pickle
import time
import zipfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import save as to_safetensors

from ...physics.random_numbers.seeds import make_generator
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import write_bytes
from ...support.system import remove
from ..matchers.network_matchers import fill_parameters, read_parameters
from ..networks.icynet import IcyNet
from .export_network import export_onnx
from .losses import compute_loss
from .sources import GroundSource
from .trainable import ICYNET, Trainable
from .training_record import make_metadata, write_record

#: Arrays of a sample that training needs.
_KEYS = ("left", "right", "disparity_px", "valid", "occluded")
_LOG_COLUMNS = ("step", "loss", "disparity", "levels", "confidence", "bad_1", "rate", "seconds")
_FORMAT = 1
#: The file with only the weights, which the matcher icynet reads.
WEIGHTS_FILE = "weights.safetensors"
#: The network for ONNX Runtime.
ONNX_FILE = "weights.onnx"


@dataclass(frozen=True)
class Plan:
    """The plan of a training.

    It has ``steps`` steps of ``batch`` crops of ``crop_px`` (width, height) from pairs of ``pair_px``. The learning
    ``rate`` rises over ``warm_up`` steps and falls by a half cosine. A new ground comes every ``steps_per_ground``
    steps; ``window`` grounds are in use at a time. A step's search range is one of ``ranges_px``; points beyond it do
    not count.
    """

    steps: int
    batch: int
    crop_px: tuple[int, int] = (192, 128)
    pair_px: tuple[int, int] = (256, 192)
    ranges_px: tuple[int, ...] = (48, 48, 64, 64, 96, 128)
    rate: float = 1e-3
    warm_up: int = 100
    steps_per_ground: int = 15
    window: int = 60
    seed: int = 0

    def find_rate(self, step: int) -> float:
        """Return the learning rate of a step."""
        rise = min(1.0, (step + 1) / self.warm_up)
        return self.rate * rise * (0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * min(1.0, step / self.steps))))

    def draw_range_px(self, step: int) -> int:
        """Draw the search range of a step."""
        return int(make_generator(self.seed, "training", 3, step).choice(self.ranges_px))

    def list_grounds(self, step: int) -> range:
        """List the numbers of the grounds in use at a step."""
        newest = step // self.steps_per_ground
        return range(max(0, newest - self.window + 1), newest + 1)


class CachedGrounds:
    """Samples of grounds as arrays, in files of a folder if one is given. A broken file is made again."""

    def __init__(self, pairs: GroundSource, folder: Path | None = None) -> None:
        self._pairs, self._folder = pairs, folder
        self.name = pairs.name
        self._loaded: dict[int, dict[str, Array]] = {}

    def read(self, number: int) -> dict[str, Array]:
        """Read the samples of a ground, stacked: images uint8, disparities float32."""
        if number not in self._loaded:
            self._loaded[number] = self._load(number)
        return self._loaded[number]

    def drop(self, keep: range) -> None:
        """Forget the grounds that are not in ``keep``, and remove their files."""
        for number in [each for each in self._loaded if each not in keep]:
            del self._loaded[number]
            if file := self._find_file(number):
                remove(file)

    def _find_file(self, number: int) -> Path | None:
        return self._folder and self._folder / f"{self.name}-{number:06d}.npz"

    def _load(self, number: int) -> dict[str, Array]:
        file = self._find_file(number)
        if file and file.exists():
            try:
                with np.load(file, allow_pickle=False) as found:
                    return {key: found[key] for key in _KEYS}
            except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
                pass
        samples = list(self._pairs.list_ground(number))
        stacked = {key: np.stack([each[key] for each in samples]) for key in _KEYS}
        for eye in ("left", "right"):
            stacked[eye] = np.rint(255.0 * stacked[eye]).astype(np.uint8)
        if file:
            stream = io.BytesIO()
            np.savez(stream, **stacked)
            write_bytes(file, stream.getvalue())
        return stacked


def draw_batch(grounds: CachedGrounds, plan: Plan, step: int) -> dict[str, torch.Tensor]:
    """Draw the crops of a step as tensors, from random grounds in use. Some pairs are turned upside down."""
    random = make_generator(plan.seed, "training", 2, step)
    numbers = plan.list_grounds(step)
    columns, rows = plan.crop_px
    parts: dict[str, list[Array]] = {key: [] for key in _KEYS}
    for _ in range(plan.batch):
        found = grounds.read(int(random.choice(numbers)))
        sample = int(random.integers(len(found["left"])))
        height, width = found["valid"].shape[1:]
        row, column = int(random.integers(height - rows + 1)), int(random.integers(width - columns + 1))
        step_down = -1 if random.random() < 0.3 else 1
        for key in _KEYS:
            crop = found[key][sample][..., row : row + rows, column : column + columns]
            parts[key].append(crop[..., ::step_down, :])
    batch = {key: torch.from_numpy(np.ascontiguousarray(np.stack(each))) for key, each in parts.items()}
    # A point that matches a column left of the crop is hidden in the crop.
    beyond = torch.arange(columns) + 0.5 < batch["disparity_px"]
    batch["occluded"] = batch["occluded"] | (beyond & batch["valid"])
    for eye in ("left", "right"):
        batch[eye] = batch[eye].float() / 255.0
    return batch


class Run:
    """A training run in a folder: ``checkpoint.pt``, the weights, ``log.csv``, a card and a curve.

    A run that is opened again continues after its last checkpoint. Raises IcyMoonError for a broken checkpoint, or one
    of another plan.
    """

    def __init__(
        self, plan: Plan, folder: Path, grounds: CachedGrounds, trainable: Trainable = ICYNET, device: str = "cpu"
    ) -> None:
        self.plan, self.folder, self.trainable, self._grounds, self.step = plan, folder, trainable, grounds, 0
        torch.manual_seed(plan.seed)
        self._device = torch.device(device)
        self.network = trainable.make(max(plan.ranges_px)).to(self._device)
        self._optimizer = torch.optim.AdamW(self.network.parameters(), plan.rate, weight_decay=1e-4)
        self._rows: list[dict[str, float]] = []
        if self.checkpoint.exists():
            self._restore()

    @property
    def checkpoint(self) -> Path:
        """The file with weights, optimizer, step and log."""
        return self.folder / "checkpoint.pt"

    def iterate(self) -> Iterator[dict[str, float]]:
        """Train to the end of the plan, and yield the row of each step.

        Raises IcyMoonError if the loss is not finite.
        """
        self.network.train()
        while self.step < self.plan.steps:
            start = time.perf_counter()
            row = self._train_step() | {"seconds": time.perf_counter() - start}
            self._rows.append(row)
            self.step += 1
            self._grounds.drop(self.plan.list_grounds(self.step))
            yield row

    def _train_step(self) -> dict[str, float]:
        rate = self.plan.find_rate(self.step)
        for group in self._optimizer.param_groups:
            group["lr"] = rate
        batch = {key: each.to(self._device) for key, each in draw_batch(self._grounds, self.plan, self.step).items()}
        range_px = self.plan.draw_range_px(self.step)
        found = self.trainable.run(self.network, batch["left"], batch["right"], range_px)
        parts = compute_loss(found, batch, range_px)
        if not torch.isfinite(parts["total"]):
            raise IcyMoonError(
                f"The loss of step {self.step} is not a number; the last checkpoint, {self.checkpoint}, is whole, so "
                "start again from it with a lower learning rate."
            )
        self._optimizer.zero_grad()
        parts["total"].backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self._optimizer.step()
        values = {name: float(value.detach()) for name, value in parts.items()}
        return {"step": self.step, "loss": values.pop("total"), **values, "rate": rate}

    def save(self) -> None:
        """Write the checkpoint, then the weights for the matcher icynet, then the log.

        Raises IcyMoonError if the disk is full; then the last checkpoint stays.
        """
        stream = io.BytesIO()
        torch.save(
            {
                "format": _FORMAT,
                "plan": self._describe(),
                "step": self.step,
                "network": self.network.state_dict(),
                "optimizer": self._optimizer.state_dict(),
                "rows": self._rows,
            },
            stream,
        )
        write_bytes(self.checkpoint, stream.getvalue())
        self._write_weights()
        text = io.StringIO()
        writer = csv.DictWriter(text, _LOG_COLUMNS)
        writer.writeheader()
        writer.writerows(self._rows)
        write_bytes(self.folder / "log.csv", text.getvalue().encode())

    def _write_weights(self) -> None:
        plan = self._describe()
        weights = {name: each.contiguous() for name, each in self.network.state_dict().items()}
        write_bytes(self.folder / WEIGHTS_FILE, to_safetensors(weights, make_metadata(plan, self.step)))
        write_record(self.folder, plan, self._rows)

    def finish(self) -> None:
        """Save, and write icynet for ONNX Runtime. Raises IcyMoonError if the disk is full."""
        self.save()
        if isinstance(self.network, IcyNet):
            write_bytes(self.folder / ONNX_FILE, export_onnx(self.network))

    def start_from(self, weights: Path) -> None:
        """Load the weights of an earlier training if this run is at its first step. Raises IcyMoonError if they do not
        fit.
        """
        if self.step == 0:
            fill_parameters(self.network, read_parameters(weights), weights, self.trainable.name)

    def _describe(self) -> dict[str, Any]:
        """Describe the identity of a run (plan, network and grounds) by plain values."""
        plan = {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self.plan).items()}
        return {**plan, "network": self.trainable.name, "grounds": self._grounds.name}

    def _restore(self) -> None:
        state = read_checkpoint(self.checkpoint)
        if state["plan"] != self._describe():
            raise IcyMoonError(
                f"{self.checkpoint} belongs to a run with other settings; state the same ones, or another folder."
            )
        try:
            self.network.load_state_dict(state["network"])
            self._optimizer.load_state_dict(state["optimizer"])
        except (RuntimeError, ValueError, KeyError):
            raise IcyMoonError(f"{self.checkpoint} is of another network; state another folder.") from None
        self.step, self._rows = int(state["step"]), list(state["rows"])


def read_checkpoint(file: Path) -> dict[str, Any]:
    """Read the contents of a checkpoint, without running code from it. Raises IcyMoonError for a broken file."""
    try:
        state = torch.load(file, map_location="cpu", weights_only=True)
        if state["format"] == _FORMAT and {"plan", "step", "network", "optimizer", "rows"} <= state.keys():
            return dict(state)
    except (OSError, RuntimeError, EOFError, KeyError, TypeError, ValueError, pickle.UnpicklingError):
        pass
    raise IcyMoonError(f"{file} is not a whole checkpoint of this version; remove it to begin anew.")
