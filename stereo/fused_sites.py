"""Sites that one camera saw in one pose under several Suns: one decision is made from all their pairs.

The lander digs under the last Sun: the latest date, or the last name where Suns are stated by angles.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..physics.light.ephemeris import parse_date
from ..render.pairs.pair_folder import Pair, read_pair
from ..settings.description import Restorer
from ..settings.table import TOPICS
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.files import make_json_digest
from .evaluated_pairs import RenderedPair, Source
from .measure.prepare_pair import PreparedPair

#: Settings in which pairs of a site may differ, besides the light: exposure, noise and times.
_MAY_DIFFER = {
    "sensor": ("noise_seed", "auto_exposure", "auto_percentile", "auto_target", "exposure_s"),
    "rig": ("frame", "stamp"),
}
_LIGHT = "light"
#: Increased when the same pairs of a site give other numbers or files.
_VERSION = 2


@dataclass(frozen=True)
class FusedSite:
    """The pairs of a site by one camera in one pose, the last Sun's pair last. A pair that cannot be read is a site by
    itself, and is reported when its turn comes.
    """

    pairs: tuple[RenderedPair, ...]

    @property
    def name(self) -> str:
        """The name of the last pair."""
        return self.pairs[-1].name

    @property
    def folder(self) -> Path:
        """The folder of the last pair."""
        return self.pairs[-1].folder

    def list_dependencies(self) -> list[Any]:
        """List the checksums of all pairs, and the version of the files that follow from them."""
        return [_VERSION, *(each for pair in self.pairs for each in pair.list_dependencies())]

    def prepare(self, response: Mapping[str, Mapping[str, Any]]) -> PreparedPair:
        """Prepare the last pair, see ``RenderedPair.prepare``."""
        return self.pairs[-1].prepare(response)

    def prepare_others(self, response: Mapping[str, Mapping[str, Any]]) -> Iterator[PreparedPair]:
        """Yield the site's other pairs, one at a time, because all of them may not fit into memory."""
        for pair in self.pairs[:-1]:
            yield pair.prepare(response)


def list_pairs(source: Source) -> tuple[Source, ...]:
    """List the pairs of a site, or only the source itself if it is not a site."""
    return source.pairs if isinstance(source, FusedSite) else (source,)


def find_fused_sites(sources: Sequence[Source]) -> list[Source]:
    """Group pairs by site. A site takes the position of its first pair in the order.

    Raises IcyMoonError for a pair of another program, for a site with one pair, and for two pairs under one Sun.
    """
    groups: dict[str, list[tuple[RenderedPair, Pair]]] = {}
    sites: dict[str, FusedSite | None] = {}
    unread: list[Path] = []
    restore = Restorer()
    for source in sources:
        if not isinstance(source, RenderedPair):
            raise IcyMoonError(
                f"--fuse-suns: {source.folder} does not state the pose of its camera; give pairs that were rendered "
                "here, or leave --fuse-suns out."
            )
        try:
            pair = read_pair(source.folder, restore)
        except IcyMoonError:
            sites[source.name] = FusedSite((source,))
            unread.append(source.folder)
            continue
        key = _make_site_key(pair)
        groups.setdefault(key, []).append((source, pair))
        sites.setdefault(key, None)
    found = {key: _make_site(own, unread) for key, own in groups.items()}
    return [site or found[key] for key, site in sites.items()]


def _make_site(own: Sequence[tuple[RenderedPair, Pair]], unread: Sequence[Path]) -> FusedSite:
    """Make the site of these pairs. ``unread`` are folders of pairs that cannot be read, so their site is unknown.
    Raises IcyMoonError for fewer than two pairs, and for two pairs under one Sun.
    """
    if len(own) == 1:
        readable, also, render = "", "", ""
        if unread:
            readable, also = " that can be read", f", and {unread[0]} cannot be read"
            render = "render that one again, "
        raise IcyMoonError(
            f"No other pair{readable} has the site, the camera and the pose of {own[0][1].folder}{also}; {render}give "
            "pairs of it under other Suns, or decide without fusing Suns."
        )
    first: dict[tuple[float, ...], Path] = {}
    for _, pair in own:
        sun = () if pair.sun is None else tuple(pair.sun.direction.tolist())
        same = first.setdefault(sun, pair.folder)
        if sun and same is not pair.folder:
            raise IcyMoonError(f"{same} and {pair.folder} are of one site under one Sun; leave one of them out.")
    return FusedSite(tuple(source for source, _ in sorted(own, key=lambda each: _find_time(each[1]))))


def _find_time(pair: Pair) -> tuple[str, str]:
    """Make a key that sorts pairs by date, or by name if their Suns are stated by angles."""
    light = pair.settings.light
    return ("" if light.directions_from == "ANGLES" else str(parse_date(light.date_utc))), pair.name


def _make_site_key(pair: Pair) -> str:
    """Make a key that only pairs of one site share. The key of a pair that was edited by hand is unique, because its
    settings do not describe its ground.
    """
    own = pair.id if pair.data.get("edited_by_hand") else pair.data.get("own_files_sha256", "")
    return make_json_digest([_list_shared_settings(pair.settings), pair.rectified_poses, own])


def _list_shared_settings(settings: Settings) -> list[Any]:
    return [
        [name, key, value]
        for name, values in settings.items()
        for key, value in values.items()
        if name != _LIGHT and key not in _MAY_DIFFER.get(name, ()) and not _is_of_run(name, key)
    ]


def _is_of_run(topic: str, key: str) -> bool:
    return topic in TOPICS and TOPICS[topic][key].effect == "run"
