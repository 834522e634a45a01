"""The runner with a Blender that only pretends: whatever workers do, every pair is there or named."""

from __future__ import annotations

import json
import os
import shutil
import threading
import time
from pathlib import Path

import pytest
from icymoon.commands import batch
from icymoon.render.pairs import pair_folder
from icymoon.render.plans import frozen_plan as datasets
from icymoon.render.workers import runner
from icymoon.render.workers.assign_cards import Cards
from icymoon.render.workers.manifest import MANIFEST
from icymoon.render.workers.pair_claims import Claims
from icymoon.render.workers.runner import Runner, WorkerOptions
from icymoon.settings.description import merged
from icymoon.support import system
from icymoon.support.errors import IcyMoonError
from stand import PAIRS, Stand


@pytest.fixture
def stand(tmp_path, monkeypatch):
    if os.name == "nt":
        pytest.skip("the false Blender is a script with a #! line")
    monkeypatch.setattr(runner, "_MAX_EXIT_S", 0.3)
    monkeypatch.setattr(runner, "_WAIT_S", 0.05)
    return Stand(tmp_path)


@pytest.mark.parametrize("workers", [1, 3])
def test_every_pair_is_rendered_once_and_said_once(stand, workers):
    assert stand.run(workers=workers) == {}
    stand.assert_done()
    assert sorted(stand.rendered) == sorted(p.id for p in PAIRS)
    pairs = [m for m in stand.said if m["type"] == "pair"]
    assert sorted(m["id"] for m in pairs) == sorted(p.id for p in PAIRS)
    assert [m["done"] for m in pairs] == list(range(1, len(PAIRS) + 1))
    fractions = [m["fraction"] for m in stand.said if m["type"] == "progress"]
    assert fractions[-1] == 1.0
    stand.run()
    assert len(stand.rendered) == len(PAIRS)  # nothing again


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize(
    ("workers", "cards", "given"),
    [(2, Cards("CUDA", (0, 2)), {"CUDA:0", "CUDA:2"}), (1, Cards("", (0, 2)), {"0,2"}), (2, Cards(), {"all"})],
)
def test_each_worker_has_a_graphics_card_of_its_own(stand, workers, cards, given):
    stand.behave(all="sleep")  # so that they run at the same time
    stand.run(workers=workers, cards=cards)
    stand.assert_done()
    assert set((stand.folder / "cards").read_text().split()) == given


def test_a_worker_that_dies_costs_one_attempt_at_one_pair(stand):
    stand.behave(**{PAIRS[4].id: "crash once"})
    assert stand.run() == {}
    stand.assert_done()
    counts = {p.id: stand.rendered.count(p.id) for p in PAIRS}
    assert counts.pop(PAIRS[4].id) == 2
    assert set(counts.values()) == {1}


def test_a_pair_that_kills_three_workers_is_set_aside_and_named(stand):
    bad = PAIRS[4].id
    stand.behave(**{bad: "crash"})
    failed = stand.run()
    assert list(failed) == [bad]
    assert "139" in failed[bad]
    assert stand.rendered.count(bad) == 3
    stand.assert_done(bad)
    assert [m["pair"] for m in stand.said if m["type"] == "error"] == [bad]
    stand.behave()
    assert stand.run() == {}  # another run tries again
    stand.assert_done()


def test_a_pair_that_cannot_be_built_is_not_tried_again_and_the_others_go_on(stand):
    bad = PAIRS[0].id
    stand.behave(**{bad: "refuse"})
    assert stand.run() == {bad: "The ground cannot be built."}
    assert stand.rendered.count(bad) == 1
    stand.assert_done(bad)


def test_the_disk_is_believed_and_not_the_worker(stand):
    bad = PAIRS[5].id
    stand.behave(**{bad: "lie"})  # says that it is rendered, but its files are not whole
    failed = stand.run()
    assert list(failed) == [bad]


def test_a_worker_that_hangs_after_its_work_is_ended(stand):
    stand.behave(**{"hang at the end": ""})
    start = time.monotonic()
    assert stand.run(workers=1) == {}
    assert time.monotonic() - start < 60
    stand.assert_done()


def test_a_worker_that_says_nothing_is_ended(stand):
    bad = PAIRS[2].id
    stand.behave(**{bad: "hang"})
    failed = stand.run(silence_s=1.5)
    assert list(failed) == [bad]
    assert "sent nothing" in failed[bad]
    stand.assert_done(bad)


def test_what_keeps_all_pairs_from_rendering_ends_the_run(stand):
    stand.behave(fatal="")
    with pytest.raises(IcyMoonError, match="disk is full"):
        stand.run()
    stand.behave(mute="")
    with pytest.raises(IcyMoonError, match="does not start"):
        stand.run()
    stand.blender.unlink()
    with pytest.raises(IcyMoonError, match="Cannot start"):
        stand.run()


def test_two_runners_share_the_work_and_both_end_when_it_is_done(stand):
    threads = [threading.Thread(target=stand.run) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
        assert not thread.is_alive()
    stand.assert_done()


def test_what_another_runner_is_at_is_waited_for_and_done_if_it_vanishes(stand):
    other = Claims(stand.dataset)
    assert other.take(PAIRS[3].id)
    thread = threading.Thread(target=stand.run)
    thread.start()
    deadline = time.monotonic() + 60
    while len(list((stand.dataset / "pairs").glob("*/pair.json"))) < len(PAIRS) - 1:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(0.3)
    assert thread.is_alive()
    assert PAIRS[3].id not in stand.rendered
    last = [m for m in stand.said if m["type"] == "progress"][-1]["message"]
    holder = f"process {os.getpid()} on {system.find_computer_name()}"
    assert last.endswith(f"; others render 1, such as {PAIRS[3].id} by {holder}")
    other.close()
    thread.join(60)
    stand.assert_done()


def wait_for(condition) -> None:
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_a_worker_that_hangs_is_not_waited_for_when_another_runner_has_done_its_pairs(stand):
    stand.behave(**{PAIRS[2].id: "hang"})
    hanging = threading.Thread(target=stand.run, kwargs={"workers": 1})  # which would wait for an hour
    hanging.start()
    wait_for(lambda: (stand.folder / "log").exists() and PAIRS[2].id in stand.rendered)
    stand.behave()
    assert stand.run(workers=1) == {}
    hanging.join(60)
    assert not hanging.is_alive()
    stand.assert_done()


def test_what_a_silent_worker_has_not_begun_is_given_to_another(stand, monkeypatch):
    monkeypatch.setattr(runner, "_SUSPECT_AFTER_S", 0.5)
    bad = PAIRS[2].id
    stand.behave(**{bad: "hang"})
    hanging = threading.Thread(target=stand.run)
    hanging.start()
    wait_for(lambda: all((pair.folder(stand.dataset) / "pair.json").exists() for pair in PAIRS if pair.id != bad))
    assert hanging.is_alive()
    stand.behave()
    assert stand.run(workers=1) == {}
    hanging.join(60)
    assert not hanging.is_alive()
    stand.assert_done()


class Played:
    """Stands for a worker's process: the first says what it has begun and then nothing, the others do a pair each time
    that they are asked."""

    pid, returncode, cause = 0, None, ""

    def __init__(self, jobs: list[list[str]], begins: bool, ready: Path, pairs: Path, command: list[str]) -> None:
        self.left = [pair["id"] for pair in json.loads(Path(command[-1]).read_text())["pairs"]]
        self.hangs, self.running, self.ready, self.pairs = not jobs, True, ready, pairs
        self.said = [{"type": "progress", "pair": self.left[0], "of_pair": 0.5}] if begins else []
        jobs.append(list(self.left))

    def poll(self) -> list[dict]:
        if self.hangs:
            said, self.said = self.said, []
            return said
        if not self.left:
            self.running = False
            return [{"type": "done"}]
        name = self.left.pop(0)
        shutil.copytree(self.ready / name, self.pairs / name, dirs_exist_ok=True)
        return [{"type": "pair", "id": name}]

    def stop(self) -> None:
        self.running = False


@pytest.mark.parametrize("look_s", [0.0, 60.0])
@pytest.mark.parametrize("begins", [True, False])
def test_a_silent_worker_gives_each_pair_away_once_and_keeps_the_one_that_it_has_begun(
    stand, monkeypatch, begins, look_s
):
    stand.run()
    ready = stand.folder / "ready"
    (stand.dataset / "pairs").rename(ready)
    monkeypatch.setattr(runner, "_SUSPECT_AFTER_S", 0.2)
    monkeypatch.setattr(runner, "_POLL_PAIRS_S", look_s)
    jobs: list[list[str]] = []
    monkeypatch.setattr(
        runner, "Process", lambda command, environment: Played(jobs, begins, ready, stand.dataset / "pairs", command)
    )
    assert stand.run(workers=3, silence_s=1.0) == {}
    stand.assert_done()
    hung = jobs[0]
    assert len(hung) > 1
    again = [hung[1:], hung[:1]] if begins else [hung]
    assert jobs[-len(again) :] == again
    assert sorted(name for job in jobs[: -len(again)] for name in job) == sorted(pair.id for pair in PAIRS)


def test_lines_that_are_no_messages_of_a_worker_do_no_harm(stand):
    stand.behave(babble="")
    assert stand.run() == {}
    stand.assert_done()


@pytest.mark.parametrize("end", ["error", "interrupt", "set aside"])
def test_the_manifest_says_what_is_there_however_a_run_ends(stand, monkeypatch, end):
    monkeypatch.setattr(batch, "set_stop_handler", lambda handler: None)
    datasets.freeze_plan(stand.dataset, PAIRS, "")
    if end == "error":
        stand.behave(fatal="")
    elif end == "set aside":
        stand.behave(**{PAIRS[0].id: "refuse"})

    def say(kind: str, **facts) -> None:
        if end == "interrupt" and kind == "pair":
            raise KeyboardInterrupt

    options = stand.dataset, PAIRS, WorkerOptions(1, 1, str(stand.blender)), say
    if end == "set aside":
        assert batch.render_missing(*options) == 1
    else:
        with pytest.raises(IcyMoonError if end == "error" else KeyboardInterrupt):
            batch.render_missing(*options)
    manifest = json.loads((stand.dataset / MANIFEST).read_text())
    there = {path.parent.name for path in (stand.dataset / "pairs").glob("*/pair.json")}
    assert manifest["complete"] == len(there)
    assert set(manifest["missing"]) == {pair.id for pair in PAIRS} - there
    assert list(manifest["set_aside"]) == [PAIRS[0].id] * (end == "set aside")


def test_damaged_pairs_are_missing_and_made_again(stand):
    stand.run()
    folders = [pair.folder(stand.dataset) for pair in PAIRS]
    (folders[0] / "pair.json").unlink()
    (folders[1] / "pair.json").write_text("{")
    (folders[2] / "left.exr").write_bytes(b"im")
    (folders[3] / "right.exr").unlink()
    shutil.rmtree(folders[4])
    assert stand.runner()._find_missing() == PAIRS[:5]
    for folder in folders[:4]:
        shutil.rmtree(folder)  # the false Blender, unlike ours, replaces nothing
    stand.run()
    stand.assert_done()


def test_another_camera_response_is_stated_without_a_render(stand):
    stand.run()
    changed = [type(p)(p.id, merged(p.settings, {"sensor": {"gain": 2.5}}), 0.0) for p in PAIRS]
    Runner(stand.dataset, changed, WorkerOptions(1, 1, str(stand.blender)), lambda *a, **k: None).run()
    assert len(stand.rendered) == len(PAIRS)
    for pair in changed:
        data = json.loads((pair.folder(stand.dataset) / "pair.json").read_text())
        assert data["settings"]["sensor"]["gain"] == 2.5


def test_the_pairs_of_a_silent_worker_are_looked_for_seldom(stand, monkeypatch):
    """Each look reads every pair.json among them, and the runner comes by twenty times a second."""
    monkeypatch.setattr(runner, "_SUSPECT_AFTER_S", 0.4)  # so that its other pairs are looked for too
    monkeypatch.setattr(runner, "MAX_CRASHES", 1)
    looks = []
    find = Runner._find_pairs_left
    monkeypatch.setattr(Runner, "_find_pairs_left", lambda self, worker: looks.append(worker) or find(self, worker))
    steps = []
    step = Runner._step_workers
    monkeypatch.setattr(Runner, "_step_workers", lambda self: steps.append(1) or step(self))
    stand.behave(**{PAIRS[0].id: "hang"})
    assert set(stand.run(workers=2, silence_s=4.0)) == {PAIRS[0].id}
    # Once while a worker is silent, and once when it has ended.
    assert len(looks) <= 2 * len({id(worker) for worker in looks})
    assert len(steps) > 4 * len(looks)


def test_pairs_that_are_known_to_be_complete_are_not_read_again(stand, monkeypatch):
    assert stand.run() == {}
    watched = stand.runner()
    read = []
    monkeypatch.setattr(runner, "is_complete", lambda folder: read.append(folder) or True)
    watched._complete = {pair.id for pair in PAIRS[:5]}
    worker = runner._Worker(None, None, list(PAIRS))
    assert watched._find_pairs_left(worker) == []
    assert len(read) == len(PAIRS) - 5
    assert watched._find_pairs_left(worker) == []
    assert len(read) == len(PAIRS) - 5


def test_a_complete_data_set_is_read_twice(stand, monkeypatch):
    """By the runner, and for the manifest."""
    stand.run()
    datasets.freeze_plan(stand.dataset, PAIRS, "")
    read = []
    inner = pair_folder.read_text
    monkeypatch.setattr(pair_folder, "read_text", lambda path: read.append(path.parent.name) or inner(path))
    monkeypatch.setattr(batch, "set_stop_handler", lambda handler: None)
    assert batch.render_missing(stand.dataset, list(PAIRS), WorkerOptions(1, 1, "none"), lambda *a, **k: None) == 0
    assert sorted(read) == sorted(2 * [pair.id for pair in PAIRS])


@pytest.mark.parametrize("place", ["pairs", "claims", "light"])
def test_nothing_is_rendered_through_a_link(stand, place):
    elsewhere = stand.folder / "elsewhere"
    elsewhere.mkdir()
    stand.dataset.mkdir()
    (stand.dataset / place).symlink_to(elsewhere)
    with pytest.raises(IcyMoonError, match=f"{place} is a link, and Icy Moon does not write through links"):
        stand.run()
    assert list(elsewhere.iterdir()) == []


@pytest.mark.parametrize("whole", [True, False])
def test_a_link_in_place_of_a_pair_costs_that_pair_only_and_stays(stand, whole):
    """The link leads to a pair of another data set."""
    stand.run()
    other, link = stand.folder / "elsewhere", stand.dataset / "pairs" / PAIRS[0].id
    link.rename(other)
    if not whole:
        (other / "left.exr").unlink()
    link.symlink_to(other)
    before = {path: path.read_bytes() for path in other.iterdir()}
    failed = stand.run()
    assert list(failed) == [PAIRS[0].id]
    assert link.is_symlink()
    assert {path: path.read_bytes() for path in other.iterdir()} == before
    assert not list(stand.dataset.rglob("*.part"))
