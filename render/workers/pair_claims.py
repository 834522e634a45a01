"""Which process renders which pair, where processes and machines share nothing but a folder. Imports no Blender.

A claim is a file ``claims/<pair>.<n>``, which only one process can create. That process touches it regularly. When
the touches stop, or the process is known to be gone, another may claim the pair as n + 1, which again only one can.
So no claim is taken from a process that runs. A process that was wrongly taken for dead does no harm: its files have
their own names until they are whole, and a complete pair is never written again.
"""

from __future__ import annotations

import json
import os
import secrets
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ...support import system
from ...support.file_schemas import NUMBER, PROCESS, SHA256, TEXT, Maybe, find_fault
from ...support.files import (
    PART_SUFFIX,
    explain_disk_errors,
    find_leftover_parts,
    make_part_path,
    read_text,
    write_text,
)
from ...support.foreign_bytes import parse_json
from ..pairs.baked_file import LIGHT
from ..pairs.dataset_file_names import is_claim_name, pairs_folder, remove_ours
from ..pairs.publish_pair import resolve_leftover

CLAIMS_FOLDER = "claims"
#: How often a claim is touched, and how long after the last touch it counts for nothing.
BEAT_S, STALE_S = 10.0, 60.0
#: How long a claim is touched for a holder that reports no progress, see ``report_progress``: it hangs then.
SILENCE_S = 3600.0
#: What a claim contains: its holder; a claim of baked light, once that is baked, also the checksum of its file.
_SHAPE = {
    "pid": PROCESS,
    "place": TEXT,
    "host": TEXT,
    "key": Maybe(TEXT),
    "light": Maybe({"sha256": SHA256, "cpu_seconds": NUMBER}),
}


class Claims:
    """The claims of this process in a data set; a thread keeps them fresh while any is held.

    Raises IcyMoonError where the folder cannot be written to.
    """

    def __init__(self, dataset: Path) -> None:
        self._dataset = dataset
        self._folder = dataset / CLAIMS_FOLDER
        self._pairs = pairs_folder(dataset)
        self._key = secrets.token_hex(8)  # what tells a claim of ours from another's that got the same name later
        self._held: dict[str, Path] = {}
        self._ahead: dict[Path, tuple[float, float]] = {}  # claims with times ahead: the time, and when it was seen
        self._heard = time.monotonic()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def take(self, pair: str) -> bool:
        """Claim a pair; False while another holds it. Raises IcyMoonError where it could not be written."""
        folder = make_part_path(self._pairs / pair)
        system.check_path(
            self._pairs.parent, make_part_path(folder / "pair.json")
        )  # the longest name in a pair's folder
        with explain_disk_errors("write to", self._folder):
            self._folder.mkdir(parents=True, exist_ok=True)
            claims = self._find_claims(pair)
            if claims and not self._is_stale(claims[max(claims)]):
                return False
            number = max(claims, default=0) + 1
            path = self._folder / f"{pair}.{number}"
            try:
                handle = system.retry(lambda: os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
            except FileExistsError:
                return False  # another was faster
            with os.fdopen(handle, "w", encoding="utf-8") as stream:
                json.dump(self._describe_self(), stream)
        for old in claims.values():
            self._remove(old)
        if claims:
            self._resolve_leftovers(pair)
        self._held[pair] = path
        self.report_progress()
        if self._thread is None:
            self._thread = threading.Thread(target=self._touch_claims, daemon=True)
            self._thread.start()
        return True

    def _describe_self(self) -> dict[str, Any]:
        return {
            "pid": os.getpid(),
            "place": system.find_process_scope(),
            "host": system.computer_name(),
            "key": self._key,
        }

    def state_light(self, key: str, checksum: str, cpu_seconds: float) -> None:
        """Let the claim of baked light state its file's checksum, so that other processes may use the file.

        Raises IcyMoonError if the disk refuses.
        """
        write_text(
            self._held[key],
            json.dumps(self._describe_self() | {"light": {"sha256": checksum, "cpu_seconds": cpu_seconds}}),
        )

    def find_stated_light(self, key: str) -> dict[str, Any] | None:
        """``sha256`` and ``cpu_seconds`` of the light that the newest claim of a key states; None without any."""
        claims = self._find_claims(key)
        stated = [_read_claim(claims[number]).get("light") for number in sorted(claims, reverse=True)]
        return next(filter(None, stated), None)

    def report_progress(self) -> None:
        """Note that the holder of these claims makes progress."""
        self._heard = time.monotonic()

    def release(self, pair: str) -> None:
        """Give a claim back."""
        path = self._held.pop(pair, None)
        if path is not None and self._is_mine(path):
            system.remove(path)

    def is_held(self, pair: str) -> bool:
        """Whether this process holds the claim of a pair."""
        return pair in self._held and not self.is_lost(pair)

    def is_lost(self, pair: str) -> bool:
        """Whether a pair that was claimed here has been claimed anew, since this process was taken for dead."""
        path = self._held.get(pair)
        return path is not None and not self._is_mine(path)

    @contextmanager
    def hold(self, pair: str) -> Iterator[bool]:
        """Claim a pair until the end of the ``with`` statement; gives whether that succeeded."""
        taken = self.take(pair)
        try:
            yield taken
        finally:
            if taken:
                self.release(pair)

    def find_claimed_elsewhere(self) -> set[str]:
        """The pairs that living processes hold, this one aside."""
        found: dict[str, Path] = {}
        for path in sorted(self._list_claims(), key=_claim_number):
            found[path.name.split(".")[0]] = path
        return {pair for pair, path in found.items() if not self._is_mine(path) and not self._is_stale(path)}

    def describe_holder(self, pair: str) -> str:
        """Who holds a pair, in words."""
        claims = self._find_claims(pair)
        holder = _read_claim(claims[max(claims)]) if claims else {}
        return f"process {holder['pid']} on {holder['host']}" if holder else "another process"

    def clean_up_after(self, pid: int) -> None:
        """Drop the claims of a process of this machine that has ended, and its unfinished folders."""
        for part in self._pairs.glob(f"*.{system.computer_name()}-{pid}-*{PART_SUFFIX}"):
            self._settle_leftover(part)
        for path in self._list_claims():
            holder = _read_claim(path)
            if holder.get("pid") == pid and holder.get("host") == system.computer_name():
                self._remove(path)

    def clean_up(self) -> None:
        """Settle the leftovers of processes that are gone, and remove the folder of claims if nothing is claimed."""
        # A process claims before it writes: a folder that is there now and has no claim afterwards is a leftover.
        parts = list(self._pairs.glob(f"*{PART_SUFFIX}"))
        claimed = self.find_claimed_elsewhere() | self._held.keys()
        for part in parts:
            if part.name.split(".")[0] not in claimed:
                self._settle_leftover(part)
        # Such as of the manifest, of baked light or of a claim that was to state it, of the clock, and of a pair.json
        # that was to state other settings.
        for where, pattern in (
            (self._dataset, "*"),
            (self._dataset / LIGHT, "*"),
            (self._folder, "*"),
            (self._pairs, ".clock"),
            (self._pairs, "*/*"),
        ):
            for file in find_leftover_parts(where, pattern):
                self._remove(file)
        for path in self._list_claims():
            if not self._is_mine(path) and self._is_stale(path):
                self._remove(path)
        with suppress(OSError):  # absent, or in use
            self._folder.rmdir()

    def close(self) -> None:
        """Give all claims back and stop the thread."""
        self._stop.set()
        for pair in list(self._held):
            self.release(pair)

    def _find_claims(self, pair: str) -> dict[int, Path]:
        return {_claim_number(path): path for path in self._list_claims() if path.name.startswith(f"{pair}.")}

    def _list_claims(self) -> list[Path]:
        return [path for path in self._folder.glob("*.*") if is_claim_name(path)]

    def _remove(self, path: Path) -> None:
        remove_ours(path, self._dataset)

    def _resolve_leftovers(self, pair: str) -> None:
        for part in self._pairs.glob(f"{pair}.*{PART_SUFFIX}"):
            self._settle_leftover(part)

    @staticmethod
    def _settle_leftover(part: Path) -> None:
        if part.is_dir():  # a file is another's affair, such as a clock
            with suppress(OSError):  # which leaves it for another time
                resolve_leftover(part)

    def _is_mine(self, claim: Path) -> bool:
        return _read_claim(claim).get("key") == self._key

    def _is_stale(self, claim: Path) -> bool:
        try:
            touched = claim.stat().st_mtime
        except FileNotFoundError:
            return True
        holder = _read_claim(claim)
        if holder and system.is_gone(holder["pid"], holder["place"]):
            return True
        age = self._read_clock() - touched
        return age > STALE_S or (age < -STALE_S and self._stands_still(claim, touched))

    def _stands_still(self, claim: Path, touched: float) -> bool:
        """Whether a claim has kept the same time for so long that its holder is gone.

        That time is ahead, since a clock was set back, so it does not show how old the claim is.
        """
        now = time.monotonic()
        known = self._ahead.get(claim)
        if known is None or known[0] != touched:
            known = self._ahead[claim] = touched, now
        return now - known[1] > STALE_S

    def _read_clock(self) -> float:
        """The time by the clock that stamps the files of this folder, which may be another machine's."""
        probe = make_part_path(self._pairs / ".clock")
        with explain_disk_errors("write to", probe.parent):
            probe.parent.mkdir(parents=True, exist_ok=True)
            try:
                probe.write_bytes(b"")
                return probe.stat().st_mtime
            finally:
                system.remove(probe)

    def _touch_claims(self) -> None:
        while not self._stop.wait(BEAT_S):
            for path in list(self._held.values()) if time.monotonic() - self._heard < SILENCE_S else ():
                with suppress(OSError):  # released just now, or the network folder is away for a while
                    if self._is_mine(path):
                        os.utime(path)


def _claim_number(path: Path) -> int:
    return int(path.name.rpartition(".")[2])


def _read_claim(claim: Path) -> dict[str, Any]:
    try:
        holder = parse_json(read_text(claim))
    except (OSError, ValueError):
        return {}  # gone, or being written
    return {} if find_fault(holder, _SHAPE) else dict(holder)
