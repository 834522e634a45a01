"""Claims (locks) of pairs by one process each, among processes and machines that share only a folder. A dead process's
claim is taken over. Imports no Blender.

A claim is a file ``claims/<pair>.<n>``, which only one process can create. That process touches it regularly. When the
touches stop, or the process has ended, another process may claim the pair as n + 1, and again only one can. So a
running process keeps its claims. A process that was wrongly taken for dead does no harm: its files have their own names
until they are whole, and a complete pair is never written again.
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
from ..pairs.dataset_file_names import is_claim_name, pairs_folder, remove_own_file
from ..pairs.publish_pair import resolve_leftover

CLAIMS_FOLDER = "claims"
#: Seconds between touches of a claim, and seconds after the last touch from which the claim is void.
TOUCH_INTERVAL_S, STALE_S = 10.0, 60.0
#: Seconds for which a claim is touched without progress of its holder, see ``report_progress``; after that the holder
#: counts as hung.
MAX_SILENT_S = 3600.0
#: Content of a claim: its holder; for a claim of baked light also the checksum of its file after the bake.
_CLAIM_SHAPE = {
    "pid": PROCESS,
    "place": TEXT,
    "host": TEXT,
    "key": Maybe(TEXT),
    "light": Maybe({"sha256": SHA256, "cpu_seconds": NUMBER}),
}


class Claims:
    """The claims of this process in a data set; a thread keeps them fresh while any is held.

    Raises IcyMoonError if the folder cannot be written to.
    """

    def __init__(self, dataset: Path) -> None:
        self._dataset = dataset
        self._folder = dataset / CLAIMS_FOLDER
        self._pairs = pairs_folder(dataset)
        # Distinguishes a claim of ours from another process' claim that got the same name later.
        self._key = secrets.token_hex(8)
        self._held: dict[str, Path] = {}
        # Claims whose time is in the future: this time, and the time when it was first seen.
        self._ahead: dict[Path, tuple[float, float]] = {}
        self._heard = time.monotonic()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def take(self, pair: str) -> bool:
        """Claim a pair, and return whether that succeeded; False while another process holds it. Raises IcyMoonError if
        the pair's folder could not be written."""
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
                return False  # another process was faster
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
            "host": system.find_computer_name(),
            "key": self._key,
        }

    def write_light_checksum(self, key: str, checksum: str, cpu_seconds: float) -> None:
        """Write the checksum of baked light into its claim, so that other processes may use the file.

        Raises IcyMoonError if the disk refuses.
        """
        write_text(
            self._held[key],
            json.dumps(self._describe_self() | {"light": {"sha256": checksum, "cpu_seconds": cpu_seconds}}),
        )

    def find_stated_light(self, key: str) -> dict[str, Any] | None:
        """Find ``sha256`` and ``cpu_seconds`` of the light in the newest claim of a key; None without any."""
        claims = self._find_claims(key)
        stated = [_read_claim(claims[number]).get("light") for number in sorted(claims, reverse=True)]
        return next(filter(None, stated), None)

    def report_progress(self) -> None:
        """Record that the holder of these claims makes progress."""
        self._heard = time.monotonic()

    def release(self, pair: str) -> None:
        """Give up the claim of a pair."""
        path = self._held.pop(pair, None)
        if path is not None and self._is_mine(path):
            system.remove(path)

    def is_held(self, pair: str) -> bool:
        """Return whether this process holds the claim of a pair."""
        return pair in self._held and not self.is_lost(pair)

    def is_lost(self, pair: str) -> bool:
        """Return whether another process has taken over a claim of this process, because it took this process for
        dead."""
        path = self._held.get(pair)
        return path is not None and not self._is_mine(path)

    @contextmanager
    def hold(self, pair: str) -> Iterator[bool]:
        """Claim a pair until the end of the ``with`` block, and yield whether that succeeded."""
        taken = self.take(pair)
        try:
            yield taken
        finally:
            if taken:
                self.release(pair)

    def find_claimed_elsewhere(self) -> set[str]:
        """Find the pairs that other living processes hold."""
        found: dict[str, Path] = {}
        for path in sorted(self._list_claims(), key=_claim_number):
            found[path.name.split(".")[0]] = path
        return {pair for pair, path in found.items() if not self._is_mine(path) and not self._is_stale(path)}

    def describe_holder(self, pair: str) -> str:
        """Describe the holder of a pair in words."""
        claims = self._find_claims(pair)
        holder = _read_claim(claims[max(claims)]) if claims else {}
        return f"process {holder['pid']} on {holder['host']}" if holder else "another process"

    def remove_leftovers_of(self, pid: int) -> None:
        """Remove the claims and the unfinished folders of an ended process of this machine."""
        for part in self._pairs.glob(f"*.{system.find_computer_name()}-{pid}-*{PART_SUFFIX}"):
            self._settle_leftover(part)
        for path in self._list_claims():
            holder = _read_claim(path)
            if holder.get("pid") == pid and holder.get("host") == system.find_computer_name():
                self._remove(path)

    def remove_leftovers(self) -> None:
        """Remove the leftovers of ended processes, and the folder of claims if no pair is claimed."""
        # A process claims before it writes: a folder that exists now and has no claim afterwards is a leftover.
        parts = list(self._pairs.glob(f"*{PART_SUFFIX}"))
        claimed = self.find_claimed_elsewhere() | self._held.keys()
        for part in parts:
            if part.name.split(".")[0] not in claimed:
                self._settle_leftover(part)
        # Leftover files are, for example, of the manifest, of baked light, of a claim, of the clock, and of a
        # pair.json.
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
        """Give up all claims and stop the thread."""
        self._stop.set()
        for pair in list(self._held):
            self.release(pair)

    def _find_claims(self, pair: str) -> dict[int, Path]:
        return {_claim_number(path): path for path in self._list_claims() if path.name.startswith(f"{pair}.")}

    def _list_claims(self) -> list[Path]:
        return [path for path in self._folder.glob("*.*") if is_claim_name(path)]

    def _remove(self, path: Path) -> None:
        remove_own_file(path, self._dataset)

    def _resolve_leftovers(self, pair: str) -> None:
        for part in self._pairs.glob(f"{pair}.*{PART_SUFFIX}"):
            self._settle_leftover(part)

    @staticmethod
    def _settle_leftover(part: Path) -> None:
        if part.is_dir():  # a file, such as a clock, belongs to another process
            with suppress(OSError):  # the leftover stays for the next process
                resolve_leftover(part)

    def _is_mine(self, claim: Path) -> bool:
        return _read_claim(claim).get("key") == self._key

    def _is_stale(self, claim: Path) -> bool:
        try:
            touched = claim.stat().st_mtime
        except FileNotFoundError:
            return True
        holder = _read_claim(claim)
        if holder and system.has_ended(holder["pid"], holder["place"]):
            return True
        age = self._read_clock() - touched
        return age > STALE_S or (age < -STALE_S and self._is_frozen_ahead(claim, touched))

    def _is_frozen_ahead(self, claim: Path, touched: float) -> bool:
        """Return whether a claim with a time in the future has kept that time long enough for its holder to be dead.

        The time is ahead because a clock was set back, so it does not show the age of the claim.
        """
        now = time.monotonic()
        known = self._ahead.get(claim)
        if known is None or known[0] != touched:
            known = self._ahead[claim] = touched, now
        return now - known[1] > STALE_S

    def _read_clock(self) -> float:
        """Read the time by the clock that stamps the files of this folder, possibly the clock of another machine."""
        probe = make_part_path(self._pairs / ".clock")
        with explain_disk_errors("write to", probe.parent):
            probe.parent.mkdir(parents=True, exist_ok=True)
            try:
                probe.write_bytes(b"")
                return probe.stat().st_mtime
            finally:
                system.remove(probe)

    def _touch_claims(self) -> None:
        while not self._stop.wait(TOUCH_INTERVAL_S):
            for path in list(self._held.values()) if time.monotonic() - self._heard < MAX_SILENT_S else ():
                with suppress(OSError):  # the claim was just released, or the network folder is away for a while
                    if self._is_mine(path):
                        os.utime(path)


def _claim_number(path: Path) -> int:
    return int(path.name.rpartition(".")[2])


def _read_claim(claim: Path) -> dict[str, Any]:
    try:
        holder = parse_json(read_text(claim))
    except (OSError, ValueError):
        return {}  # the claim is gone, or is being written
    return {} if find_fault(holder, _CLAIM_SHAPE) else dict(holder)
