"""The value of variety in training pairs: icynet trained on narrower sets, tested on grounds it never saw.

    python benchmarks training_worth --out FOLDER [--steps 200] [--seeds 3] [--processes 2] [--pairs PAIRS]
                                     [--data DATASET ...]

Each row has its own training, with as many steps and crops as the others: fewer grounds, one landform, high Suns only,
ground of even albedo, images without noise. With --data, the rows are trainings on rendered pairs instead, so that
data sets of the same pairs show what the quality of renders is worth. The test is the share of the pixels that are
wrong by more than 1 px on made pairs of the four held-out splits, and of a data set PAIRS, such as the plan
``datasets/held_out``. The training on everything, and each on rendered pairs, is repeated with other seeds; twice the
standard deviation of a difference of two such means is the least difference that the study can show. A stopped study
goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import torch
from icymoon.stereo.evaluated_pairs import find_sources
from icymoon.stereo.learning.grounds import FULL, Variety
from icymoon.stereo.learning.made_pairs import MadePairs
from icymoon.stereo.learning.sources import GroundSource
from icymoon.stereo.learning.train import WEIGHTS_FILE, CachedGrounds, Plan, Run
from icymoon.stereo.matchers import match
from icymoon.stereo.measure.metrics import find_wrong_share
from icymoon.stereo.training_data import PairsOfDataSet
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from icymoon.support.files import write_text

#: Steps between new grounds of a training on everything.
_STEPS_PER_GROUND = 10
#: Sizes of the crops (width, height) that a step takes, and of the pairs: half of the shipped weights' training, in px.
_CROP_PX, _PAIR_PX = (128, 96), (192, 144)
#: Crops of a step; the largest search range of a step in px.
_BATCH, _RANGES_PX = 8, (32, 48, 64, 96)
#: Splits of the made test pairs, their seed, grounds and pairs of a ground.
_SPLITS, _TEST_SEED, _TEST_GROUNDS, _PAIRS_OF_GROUND = ("ground", "landform", "body", "sun"), 900, 3, 4
#: Name of the column of the data set.
_CYCLES = "Cycles"
#: Name of the training on all that varies.
EVERYTHING = "everything"


@dataclass(frozen=True)
class Training:
    """A training: its name, what varies in it, its number of grounds (0: a new one every few steps), its seed, and the
    data set of rendered pairs that it has in place of pairs made by rays."""

    name: str
    variety: Variety = FULL
    grounds: int = 0
    seed: int = 0
    data: Path | None = None

    def open_pairs(self) -> GroundSource:
        """The pairs that it learns from."""
        if self.data is not None:
            return PairsOfDataSet(self.data, _PAIR_PX, self.seed)
        return MadePairs("train", self.seed, _PAIR_PX, self.variety)


NARROWED = (
    Training("one ground", grounds=1),
    Training("four grounds", grounds=4),
    Training("one landform", Variety(terrains=("rough",))),
    Training("Suns above 30°", Variety(suns_deg=(30.0, 65.0))),
    Training("even albedo", Variety(has_patterns=False)),
    Training("no noise", Variety(has_noise=False)),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True, help="folder of the trainings and results")
    parser.add_argument("--steps", type=int, default=200, help="steps of each training (%(default)s)")
    parser.add_argument("--seeds", type=int, default=3, help="trainings on everything (%(default)s)")
    parser.add_argument("--processes", type=int, default=2, help="trainings at a time (%(default)s)")
    parser.add_argument("--pairs", type=Path, help="data set by Cycles that is a test too")
    parser.add_argument(
        "--data", type=Path, nargs="+", default=[], help="data sets to train on, in place of narrower sets"
    )


def measure_wrong_share(weights: Path, left: Array, right: Array, truth: Array) -> float:
    """The share of the pixels with a true disparity (H, W), px, that icynet gets wrong by more than 1 px."""
    known = np.isfinite(truth) & (truth > 0)
    reach = 16 * int(np.ceil((truth[known].max() + 1) / 16))
    found, _, _ = match("icynet", left, right, {"checkpoint": str(weights), "disparities": reach, "min_disparity": 0})
    return find_wrong_share(found, truth, known)


def list_made_tests(split: str) -> list[tuple[Array, Array, Array]]:
    """Left and right image, uint8, and disparity of the test pairs of a split."""
    pairs = MadePairs(split, _TEST_SEED, _PAIR_PX)
    samples = [each for k in range(_TEST_GROUNDS) for each in islice(pairs.list_ground(k), _PAIRS_OF_GROUND)]
    return [
        (*(np.rint(255 * each[eye][0]).astype(np.uint8) for eye in ("left", "right")), each["disparity_px"])
        for each in samples
    ]


def list_rendered_tests(dataset: Path) -> list[tuple[Array, Array, Array]]:
    """Left and right image, uint8, and disparity of the pairs of a data set."""
    found = []
    for source in find_sources([dataset]):
        pair = source.prepare({})
        found.append((pair.left, pair.right, pair.depth_camera.focal_baseline_px_m / pair.truth))
    return found


def test_weights(weights: Path, dataset: Path | None) -> dict[str, float]:
    """The mean wrong share of each split, and of the data set."""
    tests: dict[str, list[Any]] = {split: list_made_tests(split) for split in _SPLITS}
    if dataset is not None:
        tests[_CYCLES] = list_rendered_tests(dataset)
    return {
        name: float(np.mean([measure_wrong_share(weights, *each) for each in pairs])) for name, pairs in tests.items()
    }


def train_and_test(training: Training, steps: int, out: Path, dataset: Path | None) -> dict[str, float]:
    """Train, or go on with, one row of the study; its mean wrong shares."""
    folder = out / f"{training.name.replace(' ', '_')}-{training.seed}"
    result = folder / "result.json"
    if not result.exists():
        torch.set_num_threads(1)
        plan = Plan(
            steps,
            _BATCH,
            _CROP_PX,
            _PAIR_PX,
            _RANGES_PX,
            warm_up=steps // 20,
            steps_per_ground=steps // training.grounds if training.grounds else _STEPS_PER_GROUND,
            seed=training.seed,
        )
        run = Run(plan, folder, CachedGrounds(training.open_pairs(), out / "grounds"))
        for _ in run.iterate():
            pass
        run.save()
        write_text(result, json.dumps(test_weights(folder / WEIGHTS_FILE, dataset)))
    return dict(json.loads(result.read_text("utf-8")))


def print_table(rows: list[tuple[Training, dict[str, float]]]) -> None:
    """Print the mean of the trainings on everything, the differences of the other means from it, and for each number of
    trainings the least difference that shows. The spread of trainings on everything stands for all rows."""
    columns = list(rows[0][1])
    names = list(dict.fromkeys(training.name for training, _ in rows))
    tables = {name: np.array([[f[c] for c in columns] for t, f in rows if t.name == name]) for name in names}
    whole = tables.pop(EVERYTHING)
    mean, spread = whole.mean(axis=0), whole.std(axis=0, ddof=1)
    print("| training | " + " | ".join(columns) + " |")
    print("|---|" + "---|" * len(columns))
    print(
        f"| {EVERYTHING}, {len(whole)} trainings, % wrong | " + " | ".join(f"{100 * each:.1f}" for each in mean) + " |"
    )
    for name, table in tables.items():
        added = (f"{100 * each:+.1f}" for each in table.mean(axis=0) - mean)
        print(f"| {name}, {len(table)}, points more | " + " | ".join(added) + " |")
    for count in sorted({len(table) for table in tables.values()}):
        shown = 2 * spread * np.sqrt(1 / count + 1 / len(whole))
        print(f"| least difference that shows, {count} | " + " | ".join(f"{100 * each:.1f}" for each in shown) + " |")


def list_trainings(seeds: int, data: Sequence[Path]) -> list[Training]:
    """The trainings on everything, and those on narrower sets or on the data sets.

    Raises IcyMoonError for two data sets of one name, since each row of the table and each folder bears a name.
    """
    names = [folder.resolve().name for folder in data]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise IcyMoonError(f"--data has two folders named {twice!r}; rename one.")
    whole = [Training(EVERYTHING, seed=k) for k in range(seeds)]
    rendered = [
        Training(name, seed=k, data=folder) for name, folder in zip(names, data, strict=True) for k in range(seeds)
    ]
    return [*whole, *(rendered or NARROWED)]


def main(options: argparse.Namespace) -> None:
    """Train, test and print."""
    trainings = list_trainings(options.seeds, options.data)
    work = partial(train_and_test, steps=options.steps, out=options.out, dataset=options.pairs)
    with ProcessPoolExecutor(options.processes) as pool:
        print_table(list(zip(trainings, pool.map(work, trainings), strict=True)))
