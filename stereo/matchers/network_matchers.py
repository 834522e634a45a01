"""Common parts of the learned matchers: checkpoint, device, and the network that is kept between pairs.

torch is imported only when a network is loaded.
"""

from __future__ import annotations

import importlib.util
import os
import pickle
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import hash_file, parse_path
from . import get_matcher_title

if TYPE_CHECKING:
    import torch
    from torch import nn

FOLDER_VARIABLE = "ICYMOON_CHECKPOINTS"  # environment variable

OPTIONS: dict[str, dict[str, Any]] = {
    "checkpoint": {
        "default": "",
        "doc": f"File with the trained parameters; by default in the folder {FOLDER_VARIABLE} or "
        "~/.local/share/icymoon/checkpoints",
    },
    "device": {
        "default": "auto",
        "choices": ("auto", "cpu", "cuda"),
        "doc": "Where the network runs; auto takes a CUDA device if there is one",
    },
    "threads": {"default": 1, "minimum": 1, "maximum": 1024, "doc": "Number of processor cores used"},
}


@dataclass(frozen=True)
class Network:
    """A network, and the source of its parameters."""

    method: str
    file: str  # the authors' name of it
    source: str
    build: Callable[[int], nn.Module]  # from the largest disparity
    advice: str = ""  # how to get parameters that no source gives
    most_px: int = 0  # the largest disparity that it is built with, if no option states one

    @property
    def remedy(self) -> str:
        """A clause on how to get the parameters."""
        return self.advice or f"download {self.file} as the README of {self.source} describes and put it there"


def check(network: Network, options: Mapping[str, Any]) -> None:
    """Raise IcyMoonError unless torch and the checkpoint exist."""
    path = find_checkpoint(network, options)
    if not path.is_file():
        raise IcyMoonError(
            f"{network.method} has no checkpoint at {path}; {network.remedy}, or give {network.method}.checkpoint=FILE."
        )
    if importlib.util.find_spec("torch") is None:
        raise IcyMoonError(f"{network.method} needs PyTorch, which this Python lacks; run: pip install torch")


def find_checkpoint(network: Network, options: Mapping[str, Any]) -> Path:
    """Find the checkpoint file of a network: the one in the options, or the default one."""
    if options["checkpoint"]:
        return parse_path(options["checkpoint"], f"{network.method}.checkpoint")
    folder = os.environ.get(FOLDER_VARIABLE) or Path.home() / ".local" / "share" / "icymoon" / "checkpoints"
    return Path(folder) / f"{network.method}.pth"


def load(network: Network, options: Mapping[str, Any]) -> tuple[nn.Module, dict[str, Any]]:
    """Load a network onto its device, ready to run; return it and facts for the provenance."""
    import torch

    torch.set_num_threads(options["threads"])
    device = options["device"]
    if device == "cuda" and not torch.cuda.is_available():
        raise IcyMoonError(f"{network.method}.device is cuda, but PyTorch finds no CUDA device here; use cpu.")
    if device == "auto":
        device = "cuda" if torch.cuda.is_available() else "cpu"
    path = find_checkpoint(network, options)
    check(network, options)
    changed = path.stat()
    state = changed.st_mtime_ns, changed.st_size
    model, digest = _load_network(network, path, state, options.get("max_disparity", network.most_px), device)
    name = torch.cuda.get_device_name() if device == "cuda" else device
    return model, {"checkpoint_sha256": digest, "device": name, "torch": torch.__version__}


@contextmanager
def guard_inference(method: str) -> Iterator[None]:
    """Run a network without gradients, in full single precision and reproducibly; report failures in one sentence."""
    import torch

    try:
        # On newer CUDA devices convolutions round their inputs to 10 bits (TF32) by default.
        exact = torch.backends.cudnn.flags(enabled=True, deterministic=True, allow_tf32=False)
        with torch.inference_mode(), exact:
            yield
    except torch.OutOfMemoryError:
        raise IcyMoonError(
            f"{get_matcher_title(method)} needs more memory than the CUDA device has; lower "
            f"{method}.max_disparity, use {method}.device=cpu or render smaller images."
        ) from None
    except RuntimeError as error:  # such as no memory on the CPU
        raise IcyMoonError(f"{get_matcher_title(method)} failed in PyTorch ({_find_first_line(error)}).") from None


def to_batch(image: Array, device: torch.device) -> torch.Tensor:
    """Convert an image (H, W, C) to a float tensor (1, C, H, W) on ``device``."""
    import torch

    return torch.from_numpy(np.ascontiguousarray(image, np.float32)).permute(2, 0, 1)[None].to(device)


@lru_cache(maxsize=2)
def _load_network(
    network: Network, path: Path, changed: tuple[int, int], max_disparity: int, device: str
) -> tuple[nn.Module, str]:
    """Load a network with the parameters in a file; return it and the file's SHA-256. ``changed`` identifies the
    version of the file.
    """
    model = network.build(max_disparity)
    fill_parameters(model, read_parameters(path), path, get_matcher_title(network.method))
    return model.eval().to(device), hash_file(path)


def read_parameters(path: Path) -> dict[str, Any]:
    """Read the tensors of a checkpoint, by name without the prefixes that training adds. Runs no code from the file.
    Raises IcyMoonError for a file that is no checkpoint.
    """
    if path.suffix == ".safetensors":
        return _read_safetensors(path)
    import torch

    _check_archive(path)
    try:
        stored = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError:  # its message is a page long
        raise IcyMoonError(f"{path} contains more than parameters, or is damaged; download it again.") from None
    except Exception as error:  # for a damaged file the parser may raise anything
        raise IcyMoonError(
            f"{path} cannot be read as a checkpoint ({_find_first_line(error)}); download it again."
        ) from None
    if isinstance(stored, dict) and isinstance(stored.get("state_dict"), dict):
        stored = stored["state_dict"]
    if not isinstance(stored, dict) or not all(isinstance(value, torch.Tensor) for value in stored.values()):
        raise IcyMoonError(f"{path} does not contain the parameters of a network; give the checkpoint itself.")
    return {str(name).removeprefix("module."): value for name, value in stored.items()}


def _read_safetensors(path: Path) -> dict[str, Any]:
    """Read the tensors of a safetensors file, by name. Such a file contains nothing but tensors and texts."""
    try:
        from safetensors.torch import load_file
    except ImportError:
        raise IcyMoonError(f'{path.name} needs the package safetensors; run: pip install "icymoon[networks]"') from None
    try:
        return dict(load_file(path))
    except Exception as error:  # its errors have no common base
        raise IcyMoonError(
            f"{path} cannot be read as a file of safetensors ({_find_first_line(error)}); copy or download it again."
        ) from None


def _check_archive(path: Path) -> None:
    """Raise IcyMoonError for a compressed archive, because it could expand beyond its size. PyTorch does not compress
    parameters.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            unfolded = sum(member.file_size for member in archive.infolist())
    except (OSError, ValueError, NotImplementedError, zipfile.BadZipFile):  # older or damaged; PyTorch reports it
        return
    if unfolded > path.stat().st_size:
        raise IcyMoonError(
            f"{path} unfolds to {unfolded / 1e6:.0f} MB, but checkpoints are not compressed; download it again."
        )


def fill_parameters(model: nn.Module, given: dict[str, Any], path: Path, title: str) -> None:
    """Load the parameters into a network. Raises IcyMoonError unless their names and shapes are exactly the
    network's.
    """
    expected = model.state_dict()
    # Counts of training steps: checkpoints from before PyTorch 0.4.1 lack them, and nothing here uses them.
    given = {name: value for name, value in expected.items() if name.endswith("num_batches_tracked")} | given
    wrong = [f"{name} is missing" for name in expected.keys() - given.keys()]
    wrong += [f"{name} is not of this network" for name in given.keys() - expected.keys()]
    wrong += [
        f"{name} has the shape {tuple(given[name].shape)}, not {tuple(value.shape)}"
        for name, value in expected.items()
        if name in given and given[name].shape != value.shape
    ]
    if wrong:
        raise IcyMoonError(
            f"{path} is not a checkpoint of {title}: {len(wrong)} of its parameters do not fit, {min(wrong)}."
        )
    model.load_state_dict(given, strict=True)


def _find_first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
