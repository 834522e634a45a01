"""Compares a data set with its plan, file by file. Imports no Blender."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...formats.exr_layout import read_sizes
from ...physics.camera.blur import describe_blur_identity
from ...physics.camera.eyes import make_camera_with_eyes
from ...physics.camera.stereo_camera import StereoCamera
from ...settings.description import Restorer
from ...settings.pair_ids import affects_pixels, find_value_in_id, make_counter, make_pair_id
from ...settings.table import list_all_settings
from ...support.errors import IcyMoonError, describe_error
from ...support.file_schemas import FILE_NAME, SHA256, Each, find_fault
from ...support.files import hash_file, list_user_files, quote, read_text
from ...support.foreign_bytes import parse_json
from ...support.number_text import format_count
from ..pairs.baked_file import LIGHT, parse_name
from ..pairs.dataset_file_names import (
    INPUTS,
    find_reason_to_keep,
    folder_of_pair,
    is_claim_name,
    is_pair_name,
    is_regular_file,
    is_unfinished_name,
    list_foreign_files,
    pairs_folder,
    remove_own_file,
)
from ..pairs.head_files import image_file, truth_file
from ..pairs.pair_folder import EYES, Pair, check_pair, is_complete, read_pair
from ..plans.frozen_plan import PLAN, read_frozen_plan
from ..plans.planned_pair import PlannedPair
from .manifest import MANIFEST
from .pair_claims import CLAIMS_FOLDER, Claims
from .shared_light import LightFile, RecordedLight

#: The id of a pair.
_PAIR_ID = re.compile(r"[0-9a-f]{12}")
#: Files and folders that a data set's folder may contain.
_EXPECTED_FILES = {"pairs", PLAN, MANIFEST, CLAIMS_FOLDER, "evaluation", "evaluation_scene", "slurm", INPUTS, LIGHT}
#: Texts for content beside the settings, see ``settings.pair_ids.make_pair_id`` and ``nodes.surface.hapke_nodes``.
_EXTRA_TEXTS = ("", "Hapke of nodes")
#: Shape of the entries by which a pair's files are checked: only names in its folder, no device and no other folder.
_FILES_SHAPE = {"files": Each({"sha256": SHA256}, FILE_NAME)}
#: Most settings that are named as differences of a pair from the plan.
_MAX_NAMED_SETTINGS = 5


@dataclass(frozen=True)
class Problem:
    """A problem: its kind, its subject (a pair's id or a path), a sentence on it, and the ``path`` that may be
    removed."""

    kind: str  # "unreadable", "missing", "broken", "foreign", "edited", "light", "leftover" or "kept"
    what: str
    text: str
    path: Path | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the problem as a message."""
        return {"kind": self.kind, "what": self.what, "message": self.text}


@dataclass(frozen=True)
class Findings:
    """The result of ``verify_data_set``: the number of planned and of complete pairs, the problems, and notes on
    missing but optional files. Without a plan (``has_plan``) the existing pairs count as planned.
    """

    pairs: int
    complete: int
    problems: tuple[Problem, ...]
    notes: tuple[str, ...] = ()
    has_plan: bool = True


def verify_data_set(dataset: Path, remove_broken: bool = False) -> Findings:
    """Check every file of a data set against the plan, the statements of its pairs, and the checksums.

    With ``remove_broken``, broken pairs and leftovers are removed, except foreign files and pairs whose files are
    unchanged since the render. Without a plan, each pair is compared only with its own entries. Raises IcyMoonError if
    there are neither a plan nor pairs. Raises it also for ``remove_broken`` without a plan, because only a plan could
    make the pairs again.
    """
    has_plan = os.path.lexists(dataset / PLAN)
    planned = {pair.id: pair for pair in read_frozen_plan(dataset).pairs} if has_plan else _find_unplanned(dataset)
    if remove_broken and not has_plan:
        raise IcyMoonError(
            f"{dataset} has no {PLAN}, so icymoon batch could not render again the files that --remove deletes; run "
            "verify without --remove, and delete files yourself."
        )
    working = Claims(dataset).find_claimed_elsewhere()
    problems: list[Problem] = []
    complete, shared = 0, _SharedChecks(RecordedLight(dataset))
    for name, pair in planned.items():
        folder = folder_of_pair(dataset, name)
        try:
            found = list(_check_pair(folder, pair, name in working, shared))
        except Exception as error:  # for example a disk that cannot be read; then nothing is removed
            found = [Problem("unreadable", name, describe_error(error, folder))]
        complete += not found
        problems += found
    problems += _check_other_files(dataset, planned.keys(), working, has_plan)
    stated = _find_stated_light(shared.light)
    problems += _check_light(dataset, stated, working, _describe_repair(has_plan))
    told = {problem.what for problem in problems if problem.kind == "foreign"}  # with the reason why it stays
    for path in dict.fromkeys(problem.path for problem in problems if problem.path) if remove_broken else ():
        if not remove_own_file(path, dataset) and path.name not in told:
            why = find_reason_to_keep(path, dataset) or "the disk does not allow it"
            problems.append(Problem("kept", path.name, f"{path} is not removed: {why}; check it yourself."))
    notes = [
        *_note_missing_light(dataset, stated),
        *(
            []
            if has_plan
            else [
                f"{dataset} has no {PLAN}, so each pair is compared with its own statements, and missing "
                "pairs are not found."
            ]
        ),
    ]
    return Findings(len(planned), complete, tuple(problems), tuple(notes), has_plan)


def _find_unplanned(dataset: Path) -> dict[str, None]:
    """Find the ids of the pairs of a data set without a plan, as ``icymoon render`` makes it."""
    found = dict.fromkeys(
        path.name
        for path in sorted(pairs_folder(dataset).glob("*"))
        if is_pair_name(path) and not is_unfinished_name(path)
    )
    renamed = [path.parent for path in list_user_files(pairs_folder(dataset), "*/pair.json")]
    if not found and renamed:
        raise IcyMoonError(
            _describe_misplaced(renamed[0])
            or f"{renamed[0]} has the name of no pair, and its pair.json cannot be read; remove it."
        )
    if not found:
        raise IcyMoonError(
            f"{dataset} has no {PLAN} and no pairs; give the folder of a data set, which icymoon batch "
            "or icymoon render made."
        )
    return found


def _describe_misplaced(folder: Path) -> str:
    """Describe in a sentence the fix for a whole pair under a wrong name; empty for anything else."""
    try:
        own = read_pair(folder).id
    except IcyMoonError:
        return ""
    if folder.name == own:
        return ""
    if (folder.parent / own).exists():
        return f"{folder} is pair {own} again, under another name; move it out of the data set."
    return f"{folder} is pair {own} under another name; call it {own}, or move it out of the data set."


class _SharedChecks:
    """Objects that are made once for all pairs of a data set, and the light that the pairs state."""

    def __init__(self, light: RecordedLight) -> None:
        self.light = light
        self.restore, self.count = Restorer(), make_counter()
        #: Name, topic and key of the settings that can change a rendered pixel.
        self.names = [
            (f"{topic}.{setting.key}", topic, setting.key)
            for topic, setting in list_all_settings()
            if affects_pixels(setting)
        ]


def _check_pair(folder: Path, planned: PlannedPair | None, working: bool, shared: _SharedChecks) -> Iterator[Problem]:
    name = folder.name
    if link := _find_link(folder):
        text = (
            f"{link} is a link, which is not part of a pair; replace it by its target, or remove it and "
            f"{_describe_repair(planned is not None)}."
        )
        strange = _find_foreign_files(folder) if link.parent == folder else ()
        yield Problem("foreign", name, " ".join([text, *strange]))
        return
    record = folder / "pair.json"
    if not record.is_file():
        why = f"{record} is not a regular file." if os.path.lexists(record) else f"{folder} has no pair.json."
        if others := tuple(_find_foreign_files(folder)):
            yield Problem("foreign", name, " ".join([why, *others]))
        elif folder.exists():
            yield Problem("broken", name, why, folder)
        else:
            yield Problem("missing", name, f"Pair {name} is {'being rendered' if working else 'missing'}.")
        return
    data = _parse_pair_json(record)
    intact = _has_rendered_files(folder, data)
    shared.light.add(folder, data)
    try:
        pair = read_pair(folder) if data is None else check_pair(folder, data, shared.restore)
        texts = [
            *(() if intact else _find_damage(pair)),
            *(
                f"{clause}; move the folder away and {_describe_repair(planned is not None)}."
                for clause in _find_contradictions(pair, planned, shared)
            ),
        ]
    except IcyMoonError as error:
        texts = [str(error)]
    for text in texts:
        if intact:
            yield Problem("foreign", name, f"{text} Its files are as they were rendered, so --remove leaves it.")
        else:
            yield Problem("broken", name, text, folder)
    for text in _find_foreign_files(folder):
        yield Problem("foreign", name, text)


def _describe_repair(has_plan: bool) -> str:
    """Describe in a clause how to make a pair again: by the plan of its data set, or without a plan by its original
    command."""
    return "run icymoon batch" if has_plan else "render the pair again"


def _find_foreign_files(folder: Path) -> Iterator[str]:
    """Yield a sentence on the files in a pair's folder that Icy Moon did not write, except links."""
    if paths := [path for path in list_foreign_files(folder) if not path.is_symlink()]:
        more = f" and {len(paths) - 1} more are" if paths[1:] else " is"
        yield f"{paths[0]}{more} not Icy Moon's; move {'them' if paths[1:] else 'it'} out of the pair's folder."


def _find_link(folder: Path) -> Path | None:
    """Find the first link among a pair's folders and files."""
    inside = [] if folder.parent.is_symlink() or folder.is_symlink() else sorted(folder.glob("*"))
    return next((path for path in (folder.parent, folder, *inside) if path.is_symlink()), None)


def _parse_pair_json(record: Path) -> object:
    """Parse the content of a ``pair.json``; None if it is missing or not JSON. Raises OSError if the system refuses
    access."""
    try:
        return parse_json(read_text(record))
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return None


def _has_rendered_files(folder: Path, data: Any) -> bool:
    """Return whether all files listed in the content of a ``pair.json`` are unchanged since the render.

    Raises OSError if the system refuses to tell.
    """
    try:
        return (
            not find_fault(data, _FILES_SHAPE)
            and bool(data["files"])
            and all(
                is_regular_file(folder / name) and hash_file(folder / name) == fact["sha256"]
                for name, fact in data["files"].items()
            )
        )
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return False


def _may_be_intact(folder: Path) -> bool:
    try:
        return _has_rendered_files(folder, _parse_pair_json(folder / "pair.json"))
    except OSError:
        return True


def _find_damage(pair: Pair) -> Iterator[str]:
    """Yield sentences on files that have changed since the render."""
    for name, fact in pair.data["files"].items():
        file = pair.folder / name
        if not file.is_file():
            yield f"{file} is missing."
        elif file.stat().st_size != fact["bytes"]:
            yield f"{file} has {file.stat().st_size} bytes, not {fact['bytes']}."
        elif hash_file(file) != fact["sha256"]:
            yield f"{file} has changed since the render: its checksum differs."


def _find_contradictions(pair: Pair, planned: PlannedPair | None, shared: _SharedChecks) -> Iterator[str]:
    """Yield the differences of a pair from the plan, as clauses. The pair's own entries justify no difference.

    Without a plan its name and its settings decide, unless the scene was edited by hand.
    """
    path, edited = pair.folder / "pair.json", bool(pair.data.get("edited_by_hand"))
    wanted = planned or PlannedPair(pair.folder.name, pair.settings, 0.0)
    if pair.id != wanted.id:
        yield f"{path} is of pair {pair.id}, not {wanted.id}"
    # The part of relief in the id depends on other topics.
    unequal = {topic for topic in wanted.settings if pair.settings.get(topic) != wanted.settings[topic]}
    others = [
        (name, pair.settings[topic][key], wanted.settings[topic][key])
        for name, topic, key in shared.names
        if (topic in unequal or key == "relief")
        and find_value_in_id(name, pair.settings) != find_value_in_id(name, wanted.settings)
    ]
    if others:
        texts = [
            f"{name} is {quote(there)} and was planned as {quote(asked)}"
            for name, there, asked in others[:_MAX_NAMED_SETTINGS]
        ]
        more = [f"{format_count(len(others) - _MAX_NAMED_SETTINGS, 'more setting')}"] * (
            len(others) > _MAX_NAMED_SETTINGS
        )
        yield f"{path}: {'; '.join([*texts, *more])}, so its settings do not give the id {wanted.id}"
    own, blur = str(pair.data.get("own_files_sha256", "")), describe_blur_identity(wanted.settings)
    if edited and planned:
        yield f"{path} states that the scene was edited by hand, and {PLAN} plans no such pair"
    elif (
        not edited
        and not others
        and not any(
            wanted.id == make_pair_id(wanted.settings, own + each + blur, shared.count) for each in _EXTRA_TEXTS
        )
    ):
        yield f"{path}: its settings and own files do not give the id {wanted.id}"
    seeds, seed = pair.data.get("seeds", {}), _find_rendered(pair, wanted).render_seed
    if seeds.get("render") != seed:
        yield f"{path}: was rendered with the seed {seeds.get('render')}, not {seed}"
    if "dataset" in seeds and seeds["dataset"] != wanted.settings.dataset.seed:
        yield f"{path}: seeds.dataset is {seeds['dataset']}, and its settings give {wanted.settings.dataset.seed}"
    yield from _find_wrong_sizes(pair, make_camera_with_eyes(wanted.settings))


def _find_rendered(pair: Pair, wanted: PlannedPair) -> PlannedPair:
    """Return the planned pair as it was rendered; a pair in the light of a projector has another id."""
    projector = pair.data.get("projector")
    name = projector.get("rendered_as") if isinstance(projector, Mapping) else None
    return replace(wanted, id=name) if isinstance(name, str) and _PAIR_ID.fullmatch(name) else wanted


def _find_wrong_sizes(pair: Pair, camera: StereoCamera) -> Iterator[str]:
    apart = {pair.truth_of_sensor(eye): camera.sensor_px(eye) for eye in EYES}
    apart |= {pair.image(eye): camera.light_px for eye in EYES}
    for each in pair.head:
        apart[pair.folder / image_file(each.name)] = each.rendered.size_px
        apart[pair.folder / truth_file(each.name)] = each.projection.size_px
    for file in (pair.folder / name for name in pair.data["files"] if name.endswith(".exr")):
        wide, high = apart.get(file, camera.rendered_px)
        sizes = read_sizes(file)
        if not sizes:
            yield f"{file} is not a complete EXR image"
        yield from (
            f"{file} has {columns} x {rows} pixels, and its settings give {wide} x {high}"
            for columns, rows in sizes - {(wide, high)}
        )


def _find_stated_light(light: RecordedLight) -> dict[LightFile, list[str]]:
    """Find the files of baked light in use. Return, for each, the ids of the pairs that were rendered with it."""
    stated: dict[LightFile, list[str]] = {}
    for pair, files in sorted(light.by_pair().items()):
        for file in set(files):
            stated.setdefault(replace(file, cpu_seconds=0.0), []).append(pair)
    return stated


def _note_missing_light(dataset: Path, stated: dict[LightFile, list[str]]) -> Iterator[str]:
    """Yield a sentence on missing baked light, if any; the images that were rendered with it are still complete."""
    folder = dataset / LIGHT
    gone = (
        {}
        if folder.is_symlink()
        else {file: pairs for file, pairs in stated.items() if not os.path.lexists(folder / file.name)}
    )
    if gone:
        first, pairs = min(file.name for file in gone), {pair for each in gone.values() for pair in each}
        more = f" and {len(gone) - 1} more are" if len(gone) > 1 else " is"
        yield (
            f"{folder / first}{more} missing, the baked light of {format_count(len(pairs), 'pair')}; their images do "
            "not need it any more, and later pairs of the same ground bake it again."
        )


def _check_light(dataset: Path, stated: dict[LightFile, list[str]], working: set[str], again: str) -> Iterator[Problem]:
    """Yield problems of the files of baked light, and of the pairs' entries on it. ``again`` is the clause on how to
    make a pair again."""
    folder = dataset / LIGHT
    if folder.is_symlink():
        yield Problem("foreign", LIGHT, f"{folder} is a link, so its light counts as absent; replace it by its target.")
        return
    checksums: dict[str, str] = {}
    for path in list_user_files(folder):
        parts = parse_name(path.name)
        if is_unfinished_name(path) and path.name.split("-")[0].split(".")[0] not in working:
            yield Problem("leftover", path.name, f"{path} was left unfinished.", path)
        elif parts and not is_regular_file(path):
            yield Problem(
                "foreign", path.name, f"{path} is not a regular file, so its light counts as absent; remove it."
            )
        elif parts:
            checksums[path.name] = checksum = hash_file(path)
            if not checksum.startswith(parts[1]):
                yield Problem(
                    "broken", path.name, f"{path} has changed since the bake: its name states another content.", path
                )
            elif parts[0] not in working and not any(file.name == path.name for file in stated):
                yield Problem("light", path.name, f"No pair states the light {path}, so it is not used; remove it.")
        elif not is_unfinished_name(path):
            yield Problem("foreign", path.name, f"{path} is not baked light.")
    for file, pairs in stated.items():
        if checksums.get(file.name, file.checksum) != file.checksum:
            who, which = (
                (f"pair {pairs[0]} was", "the pair")
                if len(pairs) == 1
                else (f"{len(pairs)} pairs such as {pairs[0]} were", "one of them")
            )
            yield Problem(
                "light",
                file.name,
                f"{folder / file.name} has another content now, and {who} rendered with "
                f"it; to bake it again, move {which} away and {again}.",
            )
    yield from _find_other_light(stated, again)


def _find_other_light(stated: dict[LightFile, list[str]], again: str) -> Iterator[Problem]:
    """Yield the pairs with the same ground and light that state different baked light."""
    for key in sorted({file.key for file in stated}):
        first, *more = sorted((pairs[0], file.checksum) for file, pairs in stated.items() if file.key == key)
        yield from (
            Problem(
                "light",
                key,
                f"Pair {pair} was rendered with other light than pair {first[0]}, although "
                f"their ground and light are the same; move one of them away and {again}.",
            )
            for pair, checksum in more
            if checksum != first[1]
        )


def _is_edited(folder: Path) -> bool:
    """Return whether a pair without a plan is of a scene that was edited by hand."""
    try:
        return bool(read_pair(folder).data.get("edited_by_hand"))
    except IcyMoonError:
        return False


def _check_other_files(dataset: Path, planned: Collection[str], working: set[str], has_plan: bool) -> Iterator[Problem]:
    """Yield problems of files that belong to no planned pair."""
    for path in list_user_files(pairs_folder(dataset)):
        name = path.name.split(".")[0]
        if is_unfinished_name(path):
            aside = _may_be_intact(path) and not is_complete(path.with_name(name))
            if aside and name not in working:
                fix = "icymoon batch puts it into its place" if has_plan else f"rename it to {name}"
                yield Problem("leftover", path.name, f"{path} is a whole pair; {fix}.")
            elif name not in working:
                yield Problem("leftover", path.name, f"{path} was left unfinished.", path)
        elif name not in planned and is_pair_name(path) and _is_edited(path):
            yield Problem(
                "edited",
                path.name,
                f"Pair {path} was edited by hand: its settings do not determine its images, and no plan has it.",
            )
        elif name not in planned or path.name != name:
            yield Problem(
                "foreign",
                path.name,
                _describe_misplaced(path)
                or (f"{path} is {'not of this plan' if has_plan else 'no pair'}; move it out of the data set."),
            )
    for path in list_user_files(dataset / CLAIMS_FOLDER):
        if is_unfinished_name(path):
            if path.name.split(".")[0] not in working:
                yield Problem("leftover", path.name, f"{path} was left unfinished.", path)
        elif not is_claim_name(path):
            yield Problem("foreign", path.name, f"{path} is not a claim.")
        elif path.name.split(".")[0] not in working:
            yield Problem("leftover", path.name, f"{path} is the claim of a process that is gone.", path)
    for path in list_user_files(dataset):
        if is_unfinished_name(path):
            yield Problem("leftover", path.name, f"{path} was left unfinished.", path)
        elif path.name not in _EXPECTED_FILES:
            yield Problem("foreign", path.name, f"{path} is not of this data set; move it out.")
