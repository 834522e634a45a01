"""Claims: one holder at a time, among threads, processes and machines; nothing is taken out of living hands."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from icymoon.render.workers import pair_claims
from icymoon.render.workers.pair_claims import Claims
from icymoon.support import system
from icymoon.support.errors import IcyMoonError

PAIR = "0123456789ab"


def dead_process() -> int:
    """Number of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def left_by(tmp_path, pid: int, place: str, age_s: float, name: str = f"{PAIR}.1") -> None:
    """A claim as another process left it."""
    path = tmp_path / pair_claims.CLAIMS_FOLDER / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(f'{{"pid": {pid}, "place": "{place}", "host": "elsewhere"}}')
    then = time.time() - age_s
    os.utime(path, (then, then))


def test_one_holder_at_a_time(tmp_path):
    one, other = Claims(tmp_path), Claims(tmp_path)
    assert one.take(PAIR)
    assert not other.take(PAIR)
    assert other.find_claimed_elsewhere() == {PAIR}
    assert one.find_claimed_elsewhere() == set()
    one.release(PAIR)
    assert other.take(PAIR)
    other.close()
    assert not Claims(tmp_path).find_claimed_elsewhere()


def test_a_claim_is_a_file_like_others_of_its_name_even_in_a_new_data_set(tmp_path):
    dataset = tmp_path / "new" / "dataset"
    Claims(dataset).take(PAIR)
    (tmp_path / "other").touch()
    (claim,) = (dataset / pair_claims.CLAIMS_FOLDER).iterdir()
    assert claim.name == f"{PAIR}.1"
    assert claim.stat().st_mode == (tmp_path / "other").stat().st_mode  # so others may touch and remove it


def test_a_claim_that_is_given_back_while_it_is_read_holds_nothing(tmp_path, monkeypatch):
    left_by(tmp_path, 1, "another machine", 0.0)

    def listed(path) -> bool:
        path.unlink()
        return True

    monkeypatch.setattr(pair_claims, "is_claim_name", listed)
    assert Claims(tmp_path).find_claimed_elsewhere() == set()


def test_of_many_that_try_at_once_one_gets_it(tmp_path):
    for left in (False, True):
        folder = tmp_path / str(left)
        folder.mkdir()
        if left:
            left_by(folder, 1, "another machine", 2 * pair_claims.STALE_S)
        start, got = threading.Barrier(16), []

        def attempt(folder=folder, start=start, got=got) -> None:
            mine = Claims(folder)
            start.wait()
            if mine.take(PAIR):
                got.append(mine)

        threads = [threading.Thread(target=attempt) for _ in range(16)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(got) == 1


def test_a_dead_process_of_this_machine_holds_nothing(tmp_path):
    left_by(tmp_path, dead_process(), system.find_process_scope(), 0.0)
    (tmp_path / "pairs" / f"{PAIR}.host-1-1.part").mkdir(parents=True)
    mine = Claims(tmp_path)
    assert mine.take(PAIR)
    assert list((tmp_path / "pairs").iterdir()) == []  # what it left half-written
    assert [p.name for p in (tmp_path / pair_claims.CLAIMS_FOLDER).iterdir()] == [f"{PAIR}.2"]


def test_another_machine_is_believed_for_a_minute(tmp_path):
    left_by(tmp_path, 1, "another machine", 0.5 * pair_claims.STALE_S)
    assert not Claims(tmp_path).take(PAIR)
    left_by(tmp_path, 1, "another machine", 1.5 * pair_claims.STALE_S)
    assert Claims(tmp_path).take(PAIR)


def test_a_living_holder_may_miss_two_beats(tmp_path):
    """Where a share is away for a moment, or the machine is busy: its touches come, but late."""
    left_by(tmp_path, 1, "another machine", 3 * pair_claims.TOUCH_INTERVAL_S)
    assert Claims(tmp_path).find_claimed_elsewhere() == {PAIR}
    assert not Claims(tmp_path).take(PAIR)


@pytest.mark.parametrize(("older", "newer", "free"), [(2.0, 0.0, False), (0.0, 2.0, True)])
def test_of_two_claims_of_a_pair_the_one_made_last_decides(tmp_path, older, newer, free):
    """Whoever claims anew is killed before it removes the claim that had grown stale; ten comes after nine."""
    left_by(tmp_path, 1, "another machine", older * pair_claims.STALE_S, f"{PAIR}.9")
    left_by(tmp_path, 2, "another machine", newer * pair_claims.STALE_S, f"{PAIR}.10")
    mine = Claims(tmp_path)
    assert mine.describe_holder(PAIR) == "process 2 on elsewhere"
    assert mine.find_claimed_elsewhere() == (set() if free else {PAIR})
    assert mine.take(PAIR) == free
    if free:
        assert [path.name for path in (tmp_path / pair_claims.CLAIMS_FOLDER).iterdir()] == [f"{PAIR}.11"]
    mine.close()


def test_a_claim_that_is_still_being_written_counts(tmp_path):
    (tmp_path / pair_claims.CLAIMS_FOLDER).mkdir()
    (tmp_path / pair_claims.CLAIMS_FOLDER / f"{PAIR}.1").write_text("")
    assert not Claims(tmp_path).take(PAIR)


def test_a_holder_touches_its_claims(tmp_path, monkeypatch):
    monkeypatch.setattr(pair_claims, "TOUCH_INTERVAL_S", 0.05)
    mine = Claims(tmp_path)
    mine.take(PAIR)
    (path,) = (tmp_path / pair_claims.CLAIMS_FOLDER).iterdir()
    os.utime(path, (0, 0))
    deadline = time.monotonic() + 10
    while path.stat().st_mtime < time.time() - 60:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    mine.close()


def test_a_holder_that_gets_nowhere_touches_its_claims_no_more(tmp_path, monkeypatch):
    """Such as a render that hangs in a driver while the thread that touches claims lives on."""
    monkeypatch.setattr(pair_claims, "TOUCH_INTERVAL_S", 0.01)
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(pair_claims.time, "monotonic", lambda: clock.now)
    touched = threading.Event()
    monkeypatch.setattr(pair_claims.os, "utime", lambda path: Path(path).is_relative_to(tmp_path) and touched.set())
    mine = Claims(tmp_path)
    mine.take(PAIR)
    assert touched.wait(30)
    clock.now = pair_claims.MAX_SILENT_S + 1
    for _ in range(100):  # until a beat passes without a touch; one may be under way
        touched.clear()
        if not touched.wait(0.2):
            break
    assert not touched.is_set()
    mine.report_progress()
    assert touched.wait(30)
    mine.close()


def test_who_was_wrongly_held_for_dead_knows_it_and_does_no_harm(tmp_path, monkeypatch):
    sleeper, other = Claims(tmp_path), Claims(tmp_path)
    sleeper.take(PAIR)
    (path,) = (tmp_path / pair_claims.CLAIMS_FOLDER).iterdir()
    os.utime(path, (0, 0))  # as if this machine had been asleep
    assert not sleeper.is_lost(PAIR)
    assert other.take(PAIR)
    assert sleeper.is_lost(PAIR)
    sleeper.release(PAIR)
    assert Claims(tmp_path).find_claimed_elsewhere() == {PAIR}  # the other's claim stands
    assert not other.is_lost(PAIR)


def test_a_claim_that_another_made_under_the_same_name_is_not_ones_own(tmp_path):
    sleeper, other = Claims(tmp_path), Claims(tmp_path)
    sleeper.take(PAIR)
    (path,) = (tmp_path / pair_claims.CLAIMS_FOLDER).iterdir()
    os.utime(path, (0, 0))
    Claims(tmp_path).remove_leftovers()  # which forgets how many claims there have been
    assert other.take(PAIR)
    assert [p.name for p in (tmp_path / pair_claims.CLAIMS_FOLDER).iterdir()] == [path.name]
    assert sleeper.is_lost(PAIR)
    assert not other.is_lost(PAIR)
    assert sleeper.find_claimed_elsewhere() == {PAIR}
    sleeper.close()
    assert not other.is_lost(PAIR)
    other.close()


def test_sweeping_puts_a_whole_pair_into_its_place_if_that_is_free(tmp_path):
    """Such as one that was moved aside for another by a process that was killed before that other was there."""
    pairs = tmp_path / "pairs"
    for name in (7, 8):
        folder = pairs / f"{PAIR}.host-1-{name}.part"
        folder.mkdir(parents=True)
        for eye in ("left", "right"):
            (folder / f"{eye}.exr").write_text("x")
        (folder / "pair.json").write_text(
            json.dumps({"files": {f"{eye}.exr": {"bytes": 1, "sha256": "0" * 64} for eye in ("left", "right")}})
        )
    Claims(tmp_path).remove_leftovers()
    assert [path.name for path in pairs.iterdir()] == [PAIR]
    assert sorted(path.name for path in (pairs / PAIR).iterdir()) == ["left.exr", "pair.json", "right.exr"]


def test_forgetting_a_process_leaves_what_others_write_of_the_same_pair(tmp_path):
    pid = dead_process()
    left_by(tmp_path, pid, system.find_process_scope(), 0.0)
    theirs = tmp_path / "pairs" / f"{PAIR}.{socket.gethostname()}-{pid}-1.part"
    ours = tmp_path / "pairs" / f"{PAIR}.{socket.gethostname()}-{pid}1-1.part"
    for folder in (theirs, ours):
        folder.mkdir(parents=True)
    path = tmp_path / pair_claims.CLAIMS_FOLDER / f"{PAIR}.1"
    path.write_text(path.read_text().replace("elsewhere", socket.gethostname()))
    Claims(tmp_path).remove_leftovers_of(pid)
    assert ours.exists()
    assert not theirs.exists()
    assert not path.exists()


def test_forgetting_a_process_leaves_its_namesake_elsewhere_and_its_neighbours(tmp_path):
    pid = dead_process()
    left_by(tmp_path, pid, system.find_process_scope(), 0.0)  # "host": "elsewhere"
    neighbour = Claims(tmp_path)
    neighbour.take("ffffffffffff")
    Claims(tmp_path).remove_leftovers_of(pid)
    assert {path.name for path in (tmp_path / pair_claims.CLAIMS_FOLDER).iterdir()} == {f"{PAIR}.1", "ffffffffffff.1"}
    neighbour.close()


def test_sweeping_leaves_the_living_alone(tmp_path):
    mine, other = Claims(tmp_path), Claims(tmp_path)
    mine.take(PAIR)
    kept = tmp_path / "pairs" / f"{PAIR}.host-2-1.part"
    gone = tmp_path / "pairs" / "ffffffffffff.host-3-1.part"
    whole = tmp_path / "pairs" / "eeeeeeeeeeee"
    for folder in (kept, gone, whole):
        folder.mkdir(parents=True)
    other.remove_leftovers()
    assert kept.exists()
    assert whole.exists()
    assert not gone.exists()
    mine.release(PAIR)
    other.remove_leftovers()
    assert not (tmp_path / pair_claims.CLAIMS_FOLDER).exists()


def test_sweeping_removes_what_a_killed_process_left_of_the_manifest_and_nothing_else(tmp_path):
    host, dead = socket.gethostname(), dead_process()
    left = tmp_path / f"manifest.json.{host}-{dead}-1.part"
    kept = [
        tmp_path / name
        for name in (
            f"manifest.json.{host}-{os.getpid()}-1.part",
            "manifest.json",
            f"manifest.json.elsewhere-{dead}-1.part",
            f"mine.{host}-a-b.part",
            f"pairs/.clock.{host}-{os.getpid()}-1.part",
        )
    ]
    also = [
        tmp_path / name
        for name in (
            f"pairs/.clock.{host}-{dead}-1.part",
            f"light/{PAIR}.npz.{host}-{dead}-1.part",
            f"pairs/{PAIR}/pair.json.{host}-{dead}-1.part",
        )
    ]
    for file in (left, *kept, *also):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("{}")
    Claims(tmp_path).remove_leftovers()
    assert not left.exists()
    assert not any(file.exists() for file in also)
    assert all(file.exists() for file in kept)


def test_a_folder_that_cannot_be_made_is_a_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(IcyMoonError, match="file"):
        Claims(tmp_path / "file").take(PAIR)
