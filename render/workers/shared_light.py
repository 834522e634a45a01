"""Selects the baked light that a process may use: its own, or light that a complete pair or a claim states. Imports no
Blender.

Anyone may put a file into ``light/``. So a file is used only if its content has the checksum that

* a complete pair of the data set states, which was rendered with it or for which it was too noisy, or
* this process has kept, or
* the claim of the process that baked it states, until its first pair is complete.

Light that was baked by a process that ended before its first pair was complete is baked again.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...support.file_schemas import NUMBER, SHA256, TEXT, Each, Maybe, find_fault
from ..pairs import baked_file
from ..pairs.baked_file import LIGHT, BakedLight
from ..pairs.dataset_file_names import is_pair_name, is_unfinished_name, pairs_folder
from ..pairs.pair_folder import has_stated_files, read_whole
from .pair_claims import Claims

_WAIT_S = 0.5
#: The entries of ``pair.json`` on baked light.
_LIGHTS_SHAPE = Maybe(Each({"file": TEXT, "sha256": SHA256, "cpu_seconds_of_bake": Maybe(NUMBER)}, TEXT))
_PAIR_SHAPE = {"indirect": {"lights": _LIGHTS_SHAPE, "tried": _LIGHTS_SHAPE}}


@dataclass(frozen=True)
class LightFile:
    """A file of baked light that a pair or a claim states: the name in ``light/``, the key of the bake, the SHA-256
    checksum, and the processor seconds of the bake."""

    name: str
    key: str
    checksum: str
    cpu_seconds: float


@dataclass(frozen=True)
class StoredLight:
    """Baked light with its file's name and checksum in the data set."""

    light: BakedLight
    file: str
    sha256: str

    def to_json(self, share: float) -> dict[str, Any]:
        """Return the entry of ``pair.json`` on this light, with its share of the light in the images."""
        return {
            "file": self.file,
            "sha256": self.sha256,
            "samples": self.light.samples,
            "share": round(share, 5),
            "noise_of_baked": round(self.light.noise, 5),
            "noise": round(self.light.noise * share, 5),
            "cpu_seconds_of_bake": round(self.light.cpu_seconds, 3),
        }


def find_stated_light_files(pair_json: Mapping[str, Any]) -> list[LightFile]:
    """List the files of baked light in the content of a ``pair.json``, if their names are valid."""
    if find_fault(pair_json, _PAIR_SHAPE):
        return []
    found = []
    stated = pair_json["indirect"]
    for fact in (*stated.get("lights", {}).values(), *stated.get("tried", {}).values()):
        folder, _, name = fact["file"].partition("/")
        parts = baked_file.parse_name(name)
        if folder == LIGHT and parts and fact["sha256"].startswith(parts[1]):
            found.append(LightFile(name, parts[0], fact["sha256"], float(fact.get("cpu_seconds_of_bake", 0.0))))
    return found


class RecordedLight:
    """The baked light that the complete pairs of a data set record; each pair is read once."""

    def __init__(self, dataset: Path) -> None:
        self._pairs = pairs_folder(dataset)
        self._by_pair: dict[str, list[LightFile]] = {}

    def by_pair(self) -> Mapping[str, list[LightFile]]:
        """Return the light files that each complete pair records, by the pair's id."""
        for folder in self._pairs.glob("*"):
            if folder.name not in self._by_pair and is_pair_name(folder) and not is_unfinished_name(folder):
                self.add(folder)
        return self._by_pair

    def add(self, folder: Path, data: Any = None) -> list[LightFile]:
        """Add a pair that may be complete now, and return the light files that it states. Its ``pair.json`` is read
        unless ``data`` has the content.
        """
        try:
            data = read_whole(folder) if data is None else data if has_stated_files(folder, data) else None
        except OSError:
            return []
        if data is None:
            return []
        self._by_pair[folder.name] = found = find_stated_light_files(data)
        return found

    def find_by_key(self, key: str) -> list[LightFile]:
        """Find the files of the bakes with this key. Files that most pairs state come first."""
        counted = Counter(file for files in self.by_pair().values() for file in set(files) if file.key == key)
        return sorted(counted, key=lambda file: (-counted[file], file.checksum))


class SharedLight:
    """The baked light that a process uses and adds to a data set, with the claims of the process."""

    def __init__(self, dataset: Path, claims: Claims) -> None:
        self._dataset, self.claims = dataset, claims
        self._vouched = RecordedLight(dataset)
        self._known: dict[str, LightFile] = {}
        self._waiting: set[str] = set()  # keys whose claims are held until a pair states their light

    def get(self, key: str, vertices: int, rocks: int, bake: Callable[[], BakedLight]) -> tuple[StoredLight, float]:
        """Get the baked light of a ground with this number of vertices and rocks: find it, or let ``bake`` make it.
        Return it, and the processor seconds of ``bake`` in this call.

        One process bakes while others wait for it. Raises IcyMoonError if the light cannot be baked or written.
        """
        made: BakedLight | None = None
        while True:
            if found := self._find_usable(key, vertices, rocks):
                return found, made.cpu_seconds if made else 0.0
            if self.claims.is_held(key) or self.claims.take(key):
                try:
                    # Another process may have finished the bake before this one got the claim.
                    found = self._find_usable(key, vertices, rocks)
                    if found is None:
                        made = made or bake()
                        # Another process may have taken this one for dead meanwhile; then its light counts.
                        found = None if self.claims.is_lost(key) else self._keep_light(key, made)
                finally:
                    if key not in self._waiting:
                        self.claims.release(key)
                if found:
                    return found, made.cpu_seconds if made else 0.0
            else:
                self.claims.report_progress()
                time.sleep(_WAIT_S)

    def release_stated_light(self, folder: Path) -> None:
        """Release the claims of the light that a pair, which was just rendered, states."""
        for file in self._vouched.add(folder):
            if file.key in self._waiting:
                self._waiting.discard(file.key)
                self.claims.release(file.key)

    def _find_usable(self, key: str, vertices: int, rocks: int) -> StoredLight | None:
        """Find light that may be used, and read it from its file; None without such light."""
        candidates = self._vouched.find_by_key(key)
        if key in self._known:
            candidates.append(self._known[key])
        if stated := self.claims.find_stated_light(key):
            candidates.append(
                LightFile(
                    baked_file.make_file_name(key, stated["sha256"]),
                    key,
                    stated["sha256"],
                    float(stated["cpu_seconds"]),
                )
            )
        for file in candidates:
            path = self._dataset / LIGHT / file.name
            light = baked_file.read_baked_light(path, key, file.checksum, vertices, rocks)
            if light is not None:
                self._known[key] = file
                return _make_kept_light(path, file.checksum, replace(light, cpu_seconds=file.cpu_seconds))
        return None

    def _keep_light(self, key: str, light: BakedLight) -> StoredLight:
        """Write light that was baked here, and hold its claim until a pair states it."""
        path, checksum = baked_file.write_baked_light(self._dataset, key, light)
        self.claims.write_light_checksum(key, checksum, light.cpu_seconds)
        self._known[key] = LightFile(path.name, key, checksum, light.cpu_seconds)
        self._waiting.add(key)
        return _make_kept_light(path, checksum, light)


def _make_kept_light(path: Path, checksum: str, light: BakedLight) -> StoredLight:
    return StoredLight(light, f"{LIGHT}/{path.name}", checksum)
