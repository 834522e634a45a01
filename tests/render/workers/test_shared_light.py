"""Baked light is used only if this process baked it, or a pair or the claim of who baked it vouches for it."""

from __future__ import annotations

import json
import os
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from icymoon.physics.light.baked_rocks import TERM_COUNT
from icymoon.render.pairs import baked_file
from icymoon.render.pairs.baked_file import BakedLight
from icymoon.render.workers import pair_claims as claims_module
from icymoon.render.workers import shared_light
from icymoon.render.workers.pair_claims import CLAIMS_FOLDER, Claims
from icymoon.render.workers.shared_light import SharedLight, StoredLight, find_stated_light_files
from icymoon.support import system
from icymoon.support.errors import IcyMoonError
from pairs import Scene, camera, write_pair

KEY, VERTICES = "0123456789ab", 20
PAIRS = ("aaaaaaaaaaaa", "bbbbbbbbbbbb", "cccccccccccc")


def light(level: float = 1.0, seconds: float = 2.0) -> BakedLight:
    return BakedLight(
        np.full((VERTICES, 3), level, np.float32),
        np.zeros(VERTICES, np.float32),
        np.zeros((0, TERM_COUNT, 3), np.float32),
        0.02,
        0.2,
        64,
        seconds,
    )


class Baker:
    """What a process bakes, and how often it did."""

    def __init__(self, level: float = 1.0, act: Callable[[], object] = lambda: None) -> None:
        self.level, self.act, self.times = level, act, 0

    def __call__(self) -> BakedLight:
        self.times += 1
        self.act()
        return light(self.level)


def get(shared: SharedLight, bake: Callable[[], BakedLight]) -> tuple[StoredLight, float]:
    return shared.get(KEY, VERTICES, 0, bake)


def opened(dataset: Path) -> SharedLight:
    return SharedLight(dataset, Claims(dataset))


def publish(dataset: Path, name: str, kept: StoredLight | None, **facts: Any) -> Path:
    """A complete pair that was rendered with this light."""
    folder = write_pair(dataset / "pairs" / name, Scene(), camera(32, 24))
    path = folder / "pair.json"
    indirect = {"indirect": {"method": "BAKED", "lights": {"Sun": kept.to_json(0.2)}}} if kept else {}
    path.write_text(json.dumps(json.loads(path.read_text()) | indirect | facts))
    return folder


@pytest.fixture
def dataset(tmp_path, monkeypatch) -> Path:
    monkeypatch.setattr(shared_light, "_WAIT_S", 0.02)
    return tmp_path / "set"


def claimed(dataset: Path) -> list[str]:
    return sorted(path.name.split(".")[0] for path in (dataset / CLAIMS_FOLDER).glob("*"))


def test_light_is_baked_once_and_its_claim_is_held_until_a_pair_states_it(dataset):
    shared, bake = opened(dataset), Baker()
    kept, seconds = get(shared, bake)
    assert (seconds, kept.file) == (2.0, f"light/{(dataset / kept.file).name}")
    assert get(shared, bake)[1] == 0.0
    assert bake.times == 1
    assert claimed(dataset) == [KEY]
    shared.release_stated_light(publish(dataset, PAIRS[0], None))
    assert claimed(dataset) == [KEY]
    shared.release_stated_light(publish(dataset, PAIRS[1], kept))
    assert claimed(dataset) == []
    again = opened(dataset)
    assert get(again, bake)[0].light.cpu_seconds == 2.0
    assert bake.times == 1


def test_light_that_no_pair_states_is_baked_again(dataset):
    first = opened(dataset)
    kept, _ = get(first, Baker())
    first.claims.close()
    stamp = (dataset / kept.file).stat().st_mtime_ns
    bake = Baker()
    assert get(opened(dataset), bake)[0].sha256 == kept.sha256
    assert bake.times == 1
    assert (dataset / kept.file).stat().st_mtime_ns == stamp


@pytest.mark.parametrize("name", ["of its content", "of the one that pairs state", "old"])
@pytest.mark.parametrize("vouched", [False, True])
def test_brighter_light_in_the_folder_is_not_used(dataset, name, vouched):
    """Whoever may write to the folder of light alone changes no image."""
    kept, _ = get(opened(dataset), Baker())
    if vouched:
        publish(dataset, PAIRS[0], kept)
    shutil.rmtree(dataset / CLAIMS_FOLDER)
    brighter, checksum = baked_file.write_baked_light(dataset.with_name("other"), KEY, light(8.0))
    target = {"of its content": baked_file.make_file_name(KEY, checksum), "old": f"{KEY}.npz"}.get(
        name, Path(kept.file).name
    )
    (dataset / "light" / target).write_bytes(brighter.read_bytes())
    bake = Baker()
    assert get(opened(dataset), bake)[0].light.values.max() == 1.0
    assert bake.times == (0 if vouched and name != "of the one that pairs state" else 1)


def test_light_of_an_older_version_is_used_by_the_word_of_its_pairs(dataset):
    path, checksum = baked_file.write_baked_light(dataset, KEY, light())
    old = path.rename(path.with_name(f"{KEY}.npz"))
    publish(dataset, PAIRS[0], StoredLight(light(), f"light/{old.name}", checksum))
    bake = Baker(2.0)
    assert get(opened(dataset), bake)[0].file == f"light/{KEY}.npz"
    assert not bake.times
    old.write_bytes(old.read_bytes() + b"\0")
    kept, _ = get(opened(dataset), bake)
    assert (bake.times, kept.light.values.max()) == (1, 2.0)
    assert old.exists()  # it stays for its user to look at


def test_of_two_lights_that_pairs_state_the_one_of_most_counts(dataset):
    paths = [baked_file.write_baked_light(dataset, KEY, light(level)) for level in (1.0, 2.0)]
    for name, (path, checksum) in zip(PAIRS, [paths[0], paths[1], paths[1]], strict=True):
        publish(dataset, name, StoredLight(light(), f"light/{path.name}", checksum))
    assert get(opened(dataset), Baker())[0].light.values.max() == 2.0
    paths[1][0].unlink()
    assert get(opened(dataset), Baker())[0].light.values.max() == 1.0


def test_a_pair_that_found_it_too_noisy_vouches_for_it_too(dataset):
    kept, _ = get(opened(dataset), Baker())
    publish(
        dataset,
        PAIRS[0],
        None,
        indirect={"method": "TRACED", "why": "noise", "tried": {"Sun": {"file": kept.file, "sha256": kept.sha256}}},
    )
    shutil.rmtree(dataset / CLAIMS_FOLDER)
    bake = Baker()
    assert get(opened(dataset), bake)[0].sha256 == kept.sha256
    assert not bake.times


@pytest.mark.parametrize(
    "make",
    [
        lambda folder: (folder / "pair.json").unlink(),
        lambda folder: (folder / "left.exr").write_bytes(b""),
        lambda folder: folder.rename(folder.with_name("mine")),
        lambda folder: (folder / "pair.json").write_text("{"),
        lambda folder: folder.rename(folder.with_name(f"{folder.name}.host-1-1.part")),
        "link",
        "link of a file",
    ],
)
def test_what_is_no_complete_pair_vouches_for_nothing(dataset, tmp_path, make):
    path, checksum = baked_file.write_baked_light(dataset, KEY, light(8.0))
    folder = publish(dataset, PAIRS[0], StoredLight(light(), f"light/{path.name}", checksum))
    if make == "link":
        folder.symlink_to(folder.rename(tmp_path / "elsewhere"))
    elif make == "link of a file":
        (folder / "pair.json").symlink_to((folder / "pair.json").rename(tmp_path / "pair.json"))
    else:
        make(folder)
    assert get(opened(dataset), Baker())[0].light.values.max() == 1.0


@pytest.mark.parametrize(
    "indirect",
    [
        None,
        5,
        {},
        {"lights": 5},
        {"lights": {"Sun": {}}},
        {"lights": {"Sun": {"file": "light/x", "sha256": "0" * 64}}},
        {"lights": {"Sun": {"file": f"../light/{KEY}.npz", "sha256": "0" * 64}}},
        {"lights": {"Sun": {"file": f"light/../{KEY}.npz", "sha256": "0" * 64}}},
        {"lights": {"Sun": {"file": f"/light/{KEY}.npz", "sha256": "0" * 64}}},
        {"lights": {"Sun": {"file": f"light/{KEY}-{'1' * 12}.npz", "sha256": "0" * 64}}},
        {"lights": {"Sun": {"file": f"light/{KEY}.npz", "sha256": "0"}}},
        {"lights": {"Sun": {"file": f"light/{KEY}.npz", "sha256": "0" * 64, "cpu_seconds_of_bake": "x"}}},
    ],
)
def test_statements_of_other_kinds_are_none(indirect):
    assert find_stated_light_files({"indirect": indirect}) == []
    assert find_stated_light_files({}) == []


def test_others_use_it_before_its_first_pair_is_complete_by_the_word_of_its_claim(dataset):
    first, bake = opened(dataset), Baker(2.0)
    kept, _ = get(first, Baker())
    other = opened(dataset)
    assert get(other, bake)[0].sha256 == kept.sha256
    first.claims.close()
    assert get(other, bake)[0].sha256 == kept.sha256  # which it has seen vouched for
    assert not bake.times


def test_many_that_need_it_at_once_have_one_light(dataset):
    start, found, bakes = threading.Barrier(6), [], []

    def run(level: float) -> None:
        shared, bake = opened(dataset), Baker(level, lambda: time.sleep(0.1))
        bakes.append(bake)
        start.wait()
        found.append(get(shared, bake)[0].sha256)

    threads = [threading.Thread(target=run, args=(1.0 + k,)) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    assert len(found) == 6
    assert len(set(found)) == 1
    assert sum(bake.times for bake in bakes) == 1


def make_stale(dataset: Path) -> None:
    """Let all claims look as if nobody had touched them."""
    for path in (dataset / CLAIMS_FOLDER).iterdir():
        os.utime(path, (1, 1))


def test_whoever_was_taken_for_dead_takes_the_light_of_the_other(dataset):
    """It is stopped while it bakes; another bakes too, as on another kind of processor with another result."""
    other = opened(dataset)

    def stand_still() -> None:
        make_stale(dataset)
        assert get(other, Baker(2.0))[0].light.values.max() == 2.0

    shared, bake = opened(dataset), Baker(1.0, stand_still)
    kept, _ = get(shared, bake)
    assert kept.light.values.max() == 2.0
    assert bake.times == 1
    assert {path.name for path in (dataset / "light").iterdir()} == {Path(kept.file).name}
    other.release_stated_light(publish(dataset, PAIRS[0], kept))
    assert claimed(dataset) == []


def test_whoever_was_taken_for_dead_uses_its_own_light_if_the_other_failed(dataset):
    other = Claims(dataset)

    def stand_still() -> None:
        make_stale(dataset)
        assert other.take(KEY)
        threading.Timer(0.2, other.close).start()

    bake = Baker(1.0, stand_still)
    assert get(opened(dataset), bake)[0].light.values.max() == 1.0
    assert bake.times == 1


def test_a_bake_that_fails_gives_the_claim_back(dataset):
    def fail() -> BakedLight:
        raise IcyMoonError("Cycles could not bake.")

    with pytest.raises(IcyMoonError):
        get(opened(dataset), fail)
    assert claimed(dataset) == []


def test_light_that_is_damaged_while_it_is_in_use_is_baked_again(dataset):
    shared, bake = opened(dataset), Baker()
    kept, _ = get(shared, bake)
    (dataset / kept.file).write_bytes(b"")
    assert get(shared, bake)[0].sha256 == kept.sha256
    assert bake.times == 2


@pytest.mark.parametrize(
    "stated",
    [
        "x",
        {},
        {"sha256": "0"},
        {"sha256": "0" * 64, "cpu_seconds": "x"},
        {"sha256": "../../x", "cpu_seconds": 1},
        {"sha256": "0" * 64, "cpu_seconds": 1},
    ],
)
def test_a_claim_that_states_anything_else_is_no_statement(dataset, stated):
    folder = dataset / CLAIMS_FOLDER
    folder.mkdir(parents=True)
    path = folder / f"{KEY}.1"
    path.write_text(json.dumps({"pid": 2**30, "place": system.find_process_scope(), "host": "here", "light": stated}))
    os.utime(path, (1, 1))
    assert get(opened(dataset), Baker())[0].light.values.max() == 1.0


def test_pairs_are_read_once(dataset, monkeypatch):
    kept, _ = get(opened(dataset), Baker())
    publish(dataset, PAIRS[0], kept)
    read: list[str] = []
    inner = shared_light.read_whole
    monkeypatch.setattr(shared_light, "read_whole", lambda folder: read.append(folder.name) or inner(folder))
    shared = opened(dataset)
    for _ in range(5):
        get(shared, Baker())
    assert read == [PAIRS[0]]
    publish(dataset, PAIRS[1], replace(kept))
    get(shared, Baker())
    assert read == list(PAIRS[:2])


@pytest.mark.parametrize("back_s", [0.0, 86400.0])
def test_a_claim_from_a_clock_that_was_set_back_blocks_nobody_for_a_day(tmp_path, monkeypatch, back_s):
    """It counts for a minute by a clock that only runs forward."""
    now = [100.0]
    monkeypatch.setattr(claims_module.time, "monotonic", lambda: now[0])
    path = tmp_path / CLAIMS_FOLDER / f"{KEY}.1"
    path.parent.mkdir()
    path.write_text('{"pid": 1, "place": "another machine", "host": "elsewhere"}')
    ahead = time.time() + back_s
    os.utime(path, (ahead, ahead))
    mine = Claims(tmp_path)
    assert not mine.take(KEY)
    now[0] += 0.9 * claims_module.STALE_S
    assert mine.find_claimed_elsewhere() == {KEY}
    os.utime(path, (ahead + 5, ahead + 5))  # its holder lives
    now[0] += 0.9 * claims_module.STALE_S
    assert not mine.take(KEY)
    now[0] += 1.1 * claims_module.STALE_S
    assert mine.take(KEY) == (back_s > 0)  # else the clock of the folder shows that it is fresh
