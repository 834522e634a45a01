"""Combines the sweeps of a plan into pairs: each variation of a sweep with each variation of the others. Imports no
Blender.
"""

from __future__ import annotations

import itertools
import math
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...formats.calibrations.head_file import read_head
from ...formats.ies import read_ies
from ...formats.map_site import check_map
from ...formats.toml_lines import Place
from ...physics import scene_checks
from ...physics.camera.blur import describe_blur_identity
from ...physics.random_numbers.seeds import make_generator, seed_stream
from ...physics.scene_checks import Reason
from ...physics.terrain.standing_places import RockyGround, make_rocky_ground
from ...settings.description import defaults, merged
from ...settings.pair_ids import make_counter, make_pair_id
from ...settings.preset_files import make_paths_relative_to
from ...settings.table import TOPICS, list_all_settings
from ...settings.table_cache import SettingsTexts
from ...settings.topics.scene import Settings
from ...settings.user_files import find_used_files, hash_content
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import note_on_backslashes
from . import pose_sweeps, setting_sweeps
from .baked_or_traced import choose_indirect
from .overwritten_sweeps import check_overwritten
from .planned_pair import PlannedPair, compute_heading_deg
from .setting_sweeps import Sweep, Variation, check_pair_count
from .stand_in_replacements import list_files_by_name, replace_stand_ins

#: Most grounds on which the cameras of a plan are checked before the render: each takes some hundredths of a second.
MAX_CHECKED_GROUNDS = 32
#: Receives the number of checked pairs and of all pairs.
Report = Callable[[int, int], None]
#: Number of pairs between two reports.
_PAIRS_PER_REPORT = 100
#: Topics that ``scene_checks.find_reasons_in_settings`` reads, and the terrain settings that it reads.
_CHECKED_TOPICS = (
    "source",
    "surface",
    "rock_surface",
    "hapke",
    "textures",
    "rocks",
    "light",
    "lander",
    "arm",
    "excavation",
)
_CHECKED_TERRAIN = ("size_m", "body_radius_m")
_GEOMETRY_SETTINGS = [(topic, s.key) for topic, s in list_all_settings() if s.effect == "geometry"]
_RIG_SETTINGS = [("rig", s.key) for s in TOPICS["rig"].settings]
_CHECKED_SETTINGS = [
    *((topic, s.key) for topic in _CHECKED_TOPICS for s in TOPICS[topic].settings),
    *(("terrain", key) for key in _CHECKED_TERRAIN),
]
_FILE_SETTINGS = [
    *(
        (topic, s.key)
        for topic in ("source", "textures", "rocks", "excavation", "light")
        for s in TOPICS[topic].settings
    ),
    ("lander", "kind"),
    ("lander", "file"),
    ("rig", "head_file"),
]


@dataclass(frozen=True)
class PlanDesign:
    """The content of a plan from which its pairs are combined.

    ``base`` are settings, where a later variation overrides an earlier variation. ``seeds`` and ``grounds`` (the number
    of grounds of the scenes) come with their place in the file. ``draw_again`` means that sweeps draw new values for
    each seed. ``at_most`` limits the number of pairs. ``files`` is the folder of the user's own files.
    """

    base: tuple[Variation, ...] = ()
    sweeps: tuple[Sweep, ...] = ()
    seeds: tuple[int | list[int], Place] | None = None
    draw_again: bool = False
    grounds: tuple[int, Place] | None = None
    at_most: int | None = None
    files: Path | None = None


@dataclass(frozen=True)
class _Combination:
    """Complete settings, and the parts that they were made of; a later part overrides an earlier one."""

    settings: Settings
    parts: tuple[Variation, ...]

    def with_part(self, part: Variation) -> _Combination:
        """Return this combination with ``part`` over it. Both share the unchanged topics, which saves memory."""
        settings = self.settings | {topic: self.settings[topic] | values for topic, values in part.settings.items()}
        return _Combination(settings, (*self.parts, part))

    def find_place(self, *names: str) -> Place | None:
        """Find the file position that last sets one of these settings (``topic.key``), or another setting of their
        topics.
        """
        keys = [(topic, key) for topic, _, key in (name.partition(".") for name in names)]
        for part in reversed(self.parts):
            for topic, key in keys:
                if key in part.settings.get(topic, {}):
                    return part.place.at(topic, key)
        for part in reversed(self.parts):
            for topic, _ in keys:
                if topic in part.settings:
                    return part.place.at(topic, list(part.settings[topic])[-1])
        return self.parts[-1].place if self.parts else None


class _Grounds:
    """The procedural grounds of a plan, each made once."""

    def __init__(self) -> None:
        self._known: dict[str, RockyGround] = {}
        self._keys = SettingsTexts(_GEOMETRY_SETTINGS)

    def make_ground_key(self, settings: Settings) -> str:
        """Make a cache key of a procedural ground and its rocks: a text of all settings on which they depend."""
        return self._keys.of(settings)

    def find(self, settings: Settings) -> RockyGround:
        """Find or make the ground of complete settings. Raises IcyMoonError if it is from a file, or if its settings
        contradict each other."""
        if settings.source.kind != "PROCEDURAL":
            raise IcyMoonError(
                "the heights of ground from a file are not known here; state rig.x_m, rig.y_m and the pose in a "
                "cases sweep"
            )
        key = self.make_ground_key(settings)
        if key not in self._known:
            self._known[key] = make_rocky_ground(settings)
        return self._known[key]


@dataclass(frozen=True)
class CombinedPairs:
    """The pairs of a design.

    ``refused`` are the reasons why some cannot be rendered, by their ids. ``checked`` and ``unchecked`` are the
    procedural grounds on which cameras were checked or not, by ``_Grounds.make_ground_key``.
    """

    pairs: list[PlannedPair]
    refused: dict[str, str]
    checked: frozenset[str] = frozenset()
    unchecked: frozenset[str] = frozenset()


def combine(
    design: PlanDesign, most_grounds: int = MAX_CHECKED_GROUNDS, report: Report = lambda done, total: None
) -> CombinedPairs:
    """Combine the sweeps of a design into its pairs, and check them on ``most_grounds`` of its grounds.

    If no pair can be rendered, raises IcyMoonError that names the line at fault.
    """
    grounds = _Grounds()
    made = _deal_grounds(list(_list_combinations(design)), design)
    rigs = SettingsTexts(_RIG_SETTINGS)
    for sweep in _list_camera_sweeps(design):
        known: dict[str, list[Variation]] = {}
        made = [
            each.with_part(_resolve_file_paths(part, design))
            for each in made
            for part in _place_cameras(sweep, each, grounds, rigs, known)
        ]
        check_pair_count(len(made), sweep.place)
    _check_headings(made)
    made = [each for whole in made for each in _expand_headings(whole)]
    if design.at_most is not None and design.at_most < len(made):
        made = [made[k * len(made) // design.at_most] for k in range(design.at_most)]
    looked_at, unchecked = _choose_grounds_to_check(made, grounds, most_grounds)
    refusals = _find_refusals(made, grounds, looked_at, report)
    if refusals and all(refusals):
        raise refusals[0] or AssertionError
    count = make_counter()
    described = choose_indirect([each.settings for each in made])
    pairs = [
        PlannedPair(
            make_pair_id(settings, _read_content(each) + describe_blur_identity(settings), count), settings, 0.0
        )
        for each, settings in zip(made, described, strict=True)
    ]
    refused = {pair.id: str(error) for pair, error in zip(pairs, refusals, strict=True) if error}
    return CombinedPairs(pairs, refused, looked_at, unchecked)


def _list_camera_sweeps(design: PlanDesign) -> list[Sweep]:
    """List the sweeps that place cameras, in the order of their application."""
    return sorted(
        (b for b in design.sweeps if b.kind in pose_sweeps.KINDS), key=lambda b: pose_sweeps.KINDS.index(b.kind)
    )


def _resolve_file_paths(part: Variation, design: PlanDesign) -> Variation:
    """Make a part's relative files absolute: in the plan's folder of files, or beside the plan that names them."""
    if not part.settings:
        return part
    return replace(part, settings=make_paths_relative_to(design.files or part.place.file.parent, merged(part.settings)))


def _list_combinations(design: PlanDesign) -> Iterator[_Combination]:
    """Yield the combinations of the sweeps of settings, before the camera is placed."""
    base = _Combination(defaults(), ())
    for part in design.base:
        base = base.with_part(_resolve_file_paths(part, design))
    place = design.sweeps[0].place if design.sweeps else None
    each_seed: list[tuple[Variation, ...]] = [()]
    if design.seeds is not None:
        stated, place = design.seeds
        each_seed = [
            (Variation({"dataset": {"seed": seed}}, place),)
            for seed in list_seeds(stated, int(base.settings.dataset.seed))
        ]
    there = list_files_by_name(design.files) if design.files else {}
    settled = [sweep for sweep in design.sweeps if sweep.kind in setting_sweeps.KINDS]
    factors: list[list[Variation]] = []
    for k, seed in enumerate(each_seed):
        if k == 0 or design.draw_again:
            drawn_from = base.with_part(seed[0]) if seed and design.draw_again else base
            factors = [
                [
                    _resolve_file_paths(part, design)
                    for part in setting_sweeps.make_setting_variations(sweep, drawn_from.settings)
                ]
                for sweep in settled
            ]
            if place is not None:
                check_pair_count(len(each_seed) * math.prod(map(len, factors)), place)
            check_overwritten(
                drawn_from.settings,
                base.parts,
                design.seeds and design.seeds[1],
                list(zip(settled, factors, strict=True)),
                _list_camera_sweeps(design),
            )
        for chosen in itertools.product(*factors):
            made = base
            for part in (*seed, *chosen):
                made = made.with_part(part)
            yield _replace_stand_ins(made, there) if there else made


def _replace_stand_ins(made: _Combination, there: dict[str, list[Path]]) -> _Combination:
    """Replace a combination's stand-ins by the user's files of the same names."""
    place = made.find_place("textures.stand_in", "source.stand_in")
    try:
        own = replace_stand_ins(made.settings, there)
    except IcyMoonError as error:
        raise _locate_error(error, place) from None
    return made.with_part(Variation(own, place)) if own and place is not None else made


def _deal_grounds(made: list[_Combination], design: PlanDesign) -> list[_Combination]:
    """Deal the ``design.grounds`` seeds of scenes to the combinations, each about as often as the others.

    The order is random, so that the seeds do not correlate with a setting that varies. Ground from a file is the same
    for all seeds.
    """
    if design.grounds is None or design.grounds[0] == 1 or len(made) < 2:
        return made
    stated, place = design.grounds
    count = min(stated, len(made))
    order = make_generator(int(made[0].settings.dataset.seed), "plan", zlib.crc32(b"grounds")).permutation(len(made))
    children: dict[int, list[int]] = {}
    dealt = []
    for each, k in zip(made, order, strict=True):
        source, seed = each.settings.source, int(each.settings.dataset.seed)
        if source.kind == "PROCEDURAL" or source.detail:
            if seed not in children:
                children[seed] = list_seeds(count, seed)
            each = each.with_part(Variation({"dataset": {"seed": children[seed][int(k) % count]}}, place))
        dealt.append(each)
    return dealt


def list_seeds(stated: int | list[int], seed: int) -> list[int]:
    """List the seeds of scenes: the ``stated`` list, or a ``stated`` number of children of the data set's seed. A
    larger number begins with the same seeds."""
    if isinstance(stated, list):
        return stated
    return [int(seed_stream(seed, "plan", k).generate_state(1)[0] >> 1) for k in range(stated)]


def _place_cameras(
    sweep: Sweep, made: _Combination, grounds: _Grounds, rigs: SettingsTexts, known: dict[str, list[Variation]]
) -> list[Variation]:
    """Place the cameras of a sweep for a combination, once for each ground and rig."""
    key = grounds.make_ground_key(made.settings) + rigs.of(made.settings)
    if key not in known:
        try:
            known[key] = pose_sweeps.make_camera_variations(sweep, made.settings, grounds.find)
        except IcyMoonError as error:
            raise _locate_error(error, sweep.place) from None
    return known[key]


def _locate_error(error: IcyMoonError, place: Place | None) -> IcyMoonError:
    """Make an error begin with the line at fault, unless it already names a line."""
    text = str(error)
    if place is None or text.startswith(str(place.file)):
        return error
    return IcyMoonError(f"{place}: {text}" + ("" if text.endswith(".") else "."))


def _check_headings(made: list[_Combination]) -> None:
    """Raise IcyMoonError for more pairs than a plan may have, before they are made."""
    pairs = sum(int(each.settings.dataset.headings) for each in made)
    place = made[0].find_place("dataset.headings") if made else None
    if place is not None:
        check_pair_count(pairs, place)


def _expand_headings(made: _Combination) -> Iterator[_Combination]:
    """Yield the settings at each of their ``dataset.headings`` turns; that setting is 1 in the results."""
    headings = int(made.settings.dataset.headings)
    if headings == 1:
        yield made
        return
    place = made.find_place("dataset.headings")
    assert place is not None
    for k in range(headings):
        yield made.with_part(
            Variation(
                {
                    "dataset": {"headings": 1},
                    "rig": {"heading_deg": compute_heading_deg(made.settings, k, headings)},
                },
                place,
            )
        )


def _read_content(made: _Combination) -> str:
    try:
        return hash_content(made.settings)
    except IcyMoonError as error:
        raise _locate_error(error, made.find_place("source.file", "textures.albedo_file")) from None


def _choose_grounds_to_check(
    made: Sequence[_Combination], grounds: _Grounds, most: int
) -> tuple[frozenset[str], frozenset[str]]:
    """Choose the procedural grounds on which the cameras of a plan are checked: all, or ``most`` at equal steps. Return
    their keys, and the keys of the others."""
    there = list(
        dict.fromkeys(
            grounds.make_ground_key(each.settings) for each in made if each.settings.source.kind == "PROCEDURAL"
        )
    )
    chosen = frozenset(there if len(there) <= most else (there[k * len(there) // most] for k in range(most)))
    return chosen, frozenset(there) - chosen


def _find_refusals(
    made: list[_Combination], grounds: _Grounds, looked_at: frozenset[str], report: Report
) -> list[IcyMoonError | None]:
    """Find the reason why each combination cannot be rendered, as far as known before the build; None without such a
    reason.

    Cameras are checked on the grounds ``looked_at``.

    Raises IcyMoonError for a missing file, and for a camera outside the ground.
    """
    seen: set[str] = set()
    files, reasons, rigs = SettingsTexts(_FILE_SETTINGS), SettingsTexts(_CHECKED_SETTINGS), SettingsTexts(_RIG_SETTINGS)
    known: dict[str, list[Reason]] = {}
    standing_on: dict[int, tuple[RockyGround, list[int]]] = {}
    found: list[list[Reason]] = []
    for k, each in enumerate(made):
        if k % _PAIRS_PER_REPORT == 0:
            report(k, len(made))
        if (key := files.of(each.settings)) not in seen:
            seen.add(key)
            _check_files(each)
        key = reasons.of(each.settings)
        if each.settings.lander.kind != "NONE" or each.settings.excavation.path != "NONE":
            key += rigs.of(each.settings)  # an arm may surround an eye, and a trench may be too far away
        if key not in known:
            without_file = scene_checks.find_reasons_without_file(each.settings)
            known[key] = [*without_file, *scene_checks.find_reasons_in_settings(each.settings)]
        found.append(list(known[key]))
        if each.settings.source.kind == "PROCEDURAL" and grounds.make_ground_key(each.settings) in looked_at:
            try:
                ground = grounds.find(each.settings)
                standing_on.setdefault(id(ground), (ground, []))[1].append(k)
            except IcyMoonError as error:
                found[k].append(Reason(str(error)))
    for ground, those in standing_on.values():
        for k, reason in zip(those, _check_eyes(ground, [made[k] for k in those]), strict=True):
            found[k] += [reason] if reason is not None and reason not in found[k] else []
    return [_join_reasons(each, reasons) for each, reasons in zip(made, found, strict=True)]


def _check_eyes(ground: RockyGround, made: list[_Combination]) -> list[Reason | None]:
    try:
        found = scene_checks.find_eye_reasons(ground, [each.settings.rig for each in made])
    except IcyMoonError as error:  # the sizes of rocks contradict each other
        return [Reason(str(error)) for _ in made]
    for each, reason in zip(made, found, strict=True):
        if reason is not None and reason.names == scene_checks.OUTSIDE_SETTINGS:
            raise _locate_error(IcyMoonError(reason), each.find_place(*reason.names))
    return found


def _join_reasons(made: _Combination, reasons: list[Reason]) -> IcyMoonError | None:
    """Join reasons in one error, which names the line at fault of the first reason; None without reasons."""
    if not reasons:
        return None
    error = IcyMoonError(" ".join(reasons))
    place = made.find_place(*reasons[0].names) if reasons[0].names else None
    return _locate_error(error, place or _find_named_place(error, made))


def _find_named_place(error: IcyMoonError, made: _Combination) -> Place | None:
    """Find the file position of the settings that an error names."""
    named = [word.strip(",;:().") for word in str(error).split() if word.count(".") and word.split(".")[0] in TOPICS]
    return made.find_place(*named)


def _check_files(made: _Combination) -> None:
    """Raise IcyMoonError for a missing file, a height map without a size, and a head that cannot be read."""
    try:
        files = find_used_files(made.settings)
    except IcyMoonError as error:
        raise _locate_error(error, _find_named_place(error, made)) from None
    for name, path in files.items():
        if not (path.is_file() or (name == "light.kernels" and path.is_dir())):
            raise _locate_error(
                IcyMoonError(
                    f"{name}: {path} is missing{note_on_backslashes(path)}; put it there, or "
                    "extend this plan by one of your own that names another file, or that states "
                    "its folder in plan.files."
                ),
                made.find_place(name),
            )
    checks: dict[str, Callable[[Path], object]] = {}
    if made.settings.source.kind == "HEIGHT_MAP":
        checks["source.file"] = lambda path: check_map(path, made.settings)
    checks["rig.head_file"] = read_head
    checks["light.ies_file"] = read_ies
    for name in (name for name in checks if name in files):
        try:
            checks[name](files[name])
        except IcyMoonError as error:
            raise _locate_error(error, made.find_place(name)) from None
