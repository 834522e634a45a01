"""Publication of a pair, frozen and killed at every call to the system: no finished pair is ever lost."""

from __future__ import annotations

import io
import json
import os
import random
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from icymoon.render.pairs.pair_folder import is_complete, update_response
from icymoon.render.pairs.publish_pair import discard_unfinished, publish_pair
from icymoon.render.workers.pair_claims import CLAIMS_FOLDER, Claims
from icymoon.settings.description import defaults, merged
from icymoon.support.errors import IcyMoonError
from icymoon.support.files import PART_SUFFIX, make_part_path
from marks import heavy_but

PAIR = "0123456789ab"
#: All that the publication asks of the system; what pathlib, shutil and open() do goes through these.
CALLS = (
    "rename",
    "replace",
    "open",
    "stat",
    "lstat",
    "unlink",
    "mkdir",
    "rmdir",
    "scandir",
    "listdir",
    "fsync",
    "utime",
)


class Killed(BaseException):
    """The process is no more; nothing that it would still do happens."""


class Life:
    """What one thread has called, and what happens before one of its calls."""

    def __init__(self, at: int, happens: Callable[[], object] | None) -> None:
        self.at, self.happens, self.count, self.paused = at, happens, 0, False

    def call(self) -> None:
        if self.paused:
            return
        self.count += 1
        if self.count == self.at and self.happens is not None:
            self.paused = True
            self.happens()
            self.paused = False
        elif self.count >= self.at > 0 and self.happens is None:
            raise Killed


class Watched:
    """Calls to the system, of each thread that runs ``under``, counted, with something happening before one."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.count, self._lives = 0, {}
        patch.setattr(os, "fsync", lambda handle: None)  # there is no power cut here
        for where, name in ((io, "open"), *((os, name) for name in CALLS)):
            patch.setattr(where, name, self._wrapped(getattr(where, name)))

    def _wrapped(self, call: Callable) -> Callable:
        def watched(*arguments, **options):
            if life := self._lives.get(threading.get_ident()):
                life.call()
            return call(*arguments, **options)

        return watched

    def under(self, work: Callable[[], object], at: int, happens: Callable[[], object] | None) -> None:
        """Do ``work``; before its call number ``at``, ``happens`` happens; None is death."""
        life = self._lives[threading.get_ident()] = Life(at, happens)
        try:
            work()
        finally:
            del self._lives[threading.get_ident()]
            self.count = life.count


class Worker:
    """One that renders the pair, as ``worker`` and ``render_pair`` do, into files that tell whose they are."""

    def __init__(self, dataset: Path, name: str, again: bool) -> None:
        self.claims, self.name, self.again = Claims(dataset), name, again
        self.folder = dataset / "pairs" / PAIR
        self.error: IcyMoonError | OSError | None = None

    def take(self) -> bool:
        return self.claims.take(PAIR)

    def finish(self) -> None:
        try:
            if self.again or not is_complete(self.folder):
                part = make_part_path(self.folder)
                try:
                    write(part, self.name)
                    publish_pair(part, self.folder, lambda: self.claims.is_lost(PAIR), self.again)
                finally:
                    discard_unfinished(part)
        except (IcyMoonError, OSError) as error:  # what it writes may have been taken away
            self.error = error
        finally:
            self.claims.close()


def write(folder: Path, name: str) -> None:
    folder.mkdir(parents=True)
    for eye in ("left", "right"):
        (folder / f"{eye}.exr").write_text(name)
    (folder / "pair.json").write_text(
        json.dumps(
            {
                "id": PAIR,
                "of": name,
                "settings": defaults(),
                "files": {f"{eye}.exr": {"bytes": len(name), "sha256": "0" * 64} for eye in ("left", "right")},
            }
        )
    )


def content(folder: Path) -> str:
    """Whose the whole pair in a folder is; empty if there is none."""
    if not is_complete(folder):
        return ""
    name = json.loads((folder / "pair.json").read_text())["of"]
    assert {(folder / f"{eye}.exr").read_text() for eye in ("left", "right")} == {name}
    return name


class Place:
    """A data set in which something lies at the pair's place already: nothing, a part of a pair, or a whole one."""

    def __init__(self, dataset: Path, before: str) -> None:
        self.dataset, self.pairs = dataset, dataset / "pairs"
        if before:
            write(self.pairs / PAIR, "old")
        if before == "broken":
            (self.pairs / PAIR / "right.exr").unlink()

    def age(self) -> None:
        """Let a minute go by for whoever is frozen, or dead."""
        for claim in (self.dataset / CLAIMS_FOLDER).glob("*"):
            os.utime(claim, (0, 0))

    @property
    def there(self) -> str:
        return content(self.pairs / PAIR)

    def assert_tidy(self) -> None:
        Claims(self.dataset).remove_leftovers()
        assert [path.name for path in self.pairs.iterdir()] == [PAIR] * bool(self.there)
        assert not (self.dataset / CLAIMS_FOLDER).exists()


@pytest.fixture
def watched():
    with pytest.MonkeyPatch.context() as patch:
        yield Watched(patch)


CASES = [(before, again) for before in ("", "broken", "whole") for again in (False, True)]


def calls_of(watched: Watched, folder: Path, before: str, again: bool) -> int:
    """How many calls the publication makes where nobody interferes."""
    place = Place(folder, before)
    worker = Worker(place.dataset, "alone", again)
    worker.take()
    watched.under(worker.finish, 0, lambda: None)
    assert place.there == ("alone" if again or before != "whole" else "old")
    assert worker.error is None
    place.assert_tidy()
    return watched.count


@pytest.mark.ci_takes(3)
@pytest.mark.parametrize("theirs", heavy_but([True], [False, True], [False]))
@pytest.mark.parametrize(("before", "again"), CASES)
def test_whoever_stood_still_takes_nothing_from_who_went_on(tmp_path, watched, before, again, theirs):
    for k in range(1, calls_of(watched, tmp_path / "0", before, again) + 1):
        place = Place(tmp_path / str(k), before)
        frozen, other = (Worker(place.dataset, name, how) for name, how in (("frozen", again), ("other", theirs)))
        assert frozen.take()
        finished = []

        def go_on(place=place, other=other, finished=finished) -> None:
            place.age()
            assert other.take()
            other.finish()
            assert other.error is None
            finished.append(place.there)

        watched.under(frozen.finish, k, go_on)
        assert finished[0] in (("other",) if theirs else ("other", "frozen", "old"))
        assert place.there == finished[0], f"thawed before call {k}"
        place.assert_tidy()


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize(("before", "again"), CASES)
def test_whoever_is_killed_leaves_the_old_pair_or_the_new_one(tmp_path, watched, before, again):
    for k in range(1, calls_of(watched, tmp_path / "0", before, again) + 1):
        place = Place(tmp_path / str(k), before)
        dead = Worker(place.dataset, "dead", again)
        assert dead.take()
        with pytest.raises(Killed):
            watched.under(dead.finish, k, None)
        dead.claims._stop.set()
        place.age()
        if before == "whole":
            assert any(content(folder) for folder in place.pairs.iterdir()), f"killed before call {k}"
        Claims(place.dataset).remove_leftovers()
        assert place.there in {"": ("", "dead"), "broken": ("", "dead"), "whole": ("old", "dead")}[before]
        after = Worker(place.dataset, "after", True)
        assert after.take()
        after.finish()
        assert place.there == "after"
        place.assert_tidy()


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize(("before", "again"), CASES)
def test_two_at_any_two_moments_end_with_one_whole_pair(tmp_path, watched, before, again):
    """One is frozen at any moment and goes on at any moment of who took over from it; 40 of the pairs of moments."""
    calls = calls_of(watched, tmp_path / "0", before, again)
    chosen = random.Random(7)
    for number in range(1, 41):
        place = Place(tmp_path / str(number), before)
        one, other = Worker(place.dataset, "one", again), Worker(place.dataset, "other", True)
        assert one.take()
        frozen, thawed = threading.Event(), threading.Event()
        first, second = Moments(watched, one, chosen.randint(1, calls)), chosen.randint(1, 2 * calls)

        def thaw(first=first, thawed=thawed) -> None:
            thawed.set()
            first.thread.join()

        def stop(frozen=frozen, thawed=thawed) -> None:
            frozen.set()
            assert thawed.wait(30)

        first.start(stop)
        assert frozen.wait(30)
        place.age()

        def take_over(other=other) -> None:
            assert other.take()
            other.finish()

        watched.under(take_over, second, thaw)
        thaw()
        assert other.error is None, (first.at, second)
        assert place.there == "other", (first.at, second)
        place.assert_tidy()


class Moments:
    """A worker in a thread of its own, stopped before one of its calls."""

    def __init__(self, watched: Watched, worker: Worker, at: int) -> None:
        self._watched, self._worker, self.at = watched, worker, at
        self.thread = threading.Thread(target=self._run)

    def start(self, stop: Callable[[], None]) -> None:
        self._stop = stop
        self.thread.start()

    def _run(self) -> None:
        self._watched.under(self._worker.finish, self.at, self._stop)


def test_settings_stated_anew_never_meet_the_images_of_another_pair(tmp_path, watched):
    """Another pair takes the place of the one whose settings are restated, at any moment of that."""
    settings = merged(defaults(), {"sensor": {"gain": 7.0}})
    for k in range(1, 100):
        place = Place(tmp_path / str(k), "whole")
        other = Worker(place.dataset, "another", True)
        came = []

        def replace(other=other, came=came) -> None:
            came.append(other.take())
            other.finish()

        watched.under(lambda place=place: update_response(place.pairs / PAIR, settings), k, replace)
        stated = json.loads((place.pairs / PAIR / "pair.json").read_text())
        assert place.there == ("another" if came else "old")  # which compares what pair.json says with the images
        if not came:
            break
        assert stated["settings"]["sensor"]["gain"] in (7.0, defaults().sensor.gain)
        assert not list((place.pairs / PAIR).glob(f"*{PART_SUFFIX}"))
        place.assert_tidy()
    assert 5 < k < 99
    assert stated["settings"]["sensor"]["gain"] == 7.0
