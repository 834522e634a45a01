"""The verb ``train``: train a stereo network, and go on where an earlier run stopped."""

from __future__ import annotations

import argparse
import importlib.util
import time
from collections import deque
from dataclasses import replace
from pathlib import Path

from ..support import printer
from ..support.errors import IcyMoonError
from ..support.terminal import add_json_lines, as_path, check_least, tell_events

#: Packages that training imports.
_PACKAGES = ("torch", "safetensors", "onnx", "matplotlib", "cv2")
#: Seconds between checkpoints: a killed training loses at most this time.
_SAVE_INTERVAL_S = 60.0
#: Learning rate of a training that starts from weights: a third of the usual one, so that it forgets less.
_RATE_FROM_WEIGHTS = 3e-4
#: Steps whose loss is averaged for the line of progress.
_SHOWN_STEPS = 50


def add_train_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb ``train``; ``run_train`` reads them."""
    command.add_argument(
        "--out",
        type=as_path,
        required=True,
        metavar="FOLDER",
        help="folder of the run: checkpoint, weights, log and grounds; a run that is there goes on",
    )
    command.add_argument(
        "--network",
        default="icynet",
        metavar="NAME",
        help="icynet, igev, dsmnet, or MODULE:FUNCTION that makes your own (%(default)s)",
    )
    command.add_argument(
        "--data",
        nargs="+",
        default=["made"],
        metavar="DATASET",
        help="folders of data sets (their split train), or made, pairs made by rays, or made:PRESET or made:FILE.toml, "
        "such pairs on the ground of these settings; several by turns (%(default)s)",
    )
    command.add_argument(
        "--start",
        type=as_path,
        metavar="WEIGHTS",
        help="weights to start from, to fine-tune a network: a file, or icynet, the weights that come with Icy Moon",
    )
    command.add_argument(
        "--device", default="cpu", choices=("cpu", "cuda"), help="where the network is trained (%(default)s)"
    )
    command.add_argument("--steps", type=int, default=3000, metavar="N", help="steps in all (%(default)s)")
    command.add_argument("--batch", type=int, default=8, metavar="N", help="crops of a step (%(default)s)")
    command.add_argument("--seed", type=int, default=0, metavar="N", help="seed of all grounds (%(default)s)")
    add_json_lines(command)


def run_train(parsed: argparse.Namespace) -> int:
    """Run ``train`` with its parsed arguments; return the exit code."""
    check_least(parsed, 1, "steps", "batch")
    check_least(parsed, 0, "seed")
    _require_packages()
    import torch

    from .learning.train import WEIGHTS_FILE, CachedGrounds, Plan, Run
    from .learning.trainable import find_trainable
    from .matchers.icynet import SHIPPED, TITLE
    from .training_data import open_sources

    torch.set_num_threads(1)  # more change the last bits of sums, and with them the losses of a resumed run
    plan = Plan(steps=parsed.steps, batch=parsed.batch, seed=parsed.seed)
    if parsed.start:
        plan = replace(plan, rate=_RATE_FROM_WEIGHTS)
    grounds = CachedGrounds(open_sources(parsed.data, plan.pair_px, plan.seed), parsed.out / "grounds")
    if parsed.device == "cuda" and not torch.cuda.is_available():
        raise IcyMoonError("--device is cuda, but PyTorch finds no CUDA device here; use cpu.")
    run = Run(plan, parsed.out, grounds, find_trainable(parsed.network), parsed.device)
    if parsed.start:
        run.start_from(SHIPPED["safetensors"] if str(parsed.start) == TITLE else parsed.start)
    saved, recent = time.monotonic(), deque[float](maxlen=_SHOWN_STEPS)
    with tell_events("Training", parsed.json_lines) as tell:
        for row in run.iterate():
            recent.append(row["loss"])
            message = f"Step {run.step}: loss {sum(recent) / len(recent):.3f}"
            tell({"type": "progress", "done": run.step, "total": plan.steps, "message": message})
            if time.monotonic() > saved + _SAVE_INTERVAL_S:
                run.save()
                saved = time.monotonic()
        run.finish()
    _tell_result(parsed, parsed.out / WEIGHTS_FILE)
    return 0


def _require_packages() -> None:
    """Raise IcyMoonError if a package that training needs is missing."""
    missing = [name for name in _PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        raise IcyMoonError(
            f"Training needs {', '.join(missing)}, which this Python lacks; run: "
            'pip install "icymoon[evaluate,networks]".'
        )


def _tell_result(parsed: argparse.Namespace, weights: Path) -> None:
    if parsed.json_lines:
        printer.emit("trained", path=str(weights.resolve()))
    else:
        printer.say(str(weights.resolve()))
