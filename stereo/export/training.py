"""The exports ``webdataset`` and ``sceneflow``: compact copies for training, split by scene, with a data card.

They contain the developed images and the disparities of the pairs. Variations during training need no copy, see
``torch_data``.
"""

from __future__ import annotations

import csv
import io
import json
import tarfile
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...render.pairs.pair_folder import EYES
from ...render.pairs.scene_splits import find_split_of_pair, name_scene
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import explain_disk_errors, hash_file, make_part_path, write_bytes, write_json, write_text
from ...support.number_text import format_count
from ...support.system import remove, replace
from ...support.version import version
from ..images.develop import to_8_bit
from ..images.image_files import encode_image
from ..measure.prepare_pair import LoadedPair
from . import Export
from .encodings import KITTI_STEPS_PER_PX, quantise_to_16_bits, write_pfm
from .losses import Each, Loss, refuse_losses
from .whole_folders import fill_whole_folder

HEADINGS = {"webdataset": "Training"}
TITLES = {
    "webdataset": "WebDataset: tar shards for training, split by scene, with a data card",
    "sceneflow": "SceneFlow: the layout of FlyingThings3D, for training",
}
#: Least bytes of a complete shard. It ends with the pair that exceeds them.
MIN_SHARD_BYTES = 1_000_000_000
#: Unknown disparity in SceneFlow's layout, px. Loaders reject 512 px and more. NaN and infinity would spread when
#: loaders scale the map.
UNKNOWN_DISPARITY_PX = 1e5
#: Words that loaders replace in whole paths to find the other files of a pair.
_REPLACED_WORDS = ("left", "right", "disparity", "frames_cleanpass", "frames_finalpass", ".png")
_INDEX_COLUMNS = (
    "key",
    "shard",
    "split",
    "scene",
    "width_px",
    "height_px",
    "focal_px",
    "baseline_m",
    "sun_elevation_deg",
    "seed",
    "depth_median_m",
    "occluded_share",
)

#: Types of the columns of the index, unless they are numbers with a fraction.
_COLUMN_TYPES = {
    **dict.fromkeys(("key", "shard", "split", "scene"), "sc:Text"),
    **dict.fromkeys(("width_px", "height_px", "seed"), "sc:Integer"),
}
#: The terms of Croissant 1.0, as its definition has them.
_CROISSANT_CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "dct": "http://purl.org/dc/terms/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}


@dataclass
class _Index:
    """Written pairs, for the index, the data card and Croissant."""

    rows: list[dict[str, Any]] = field(default_factory=list)

    def add(self, pair: LoadedPair, split: str, shard: str) -> None:
        """Add a pair with its split and its file."""
        row = describe_row(pair, split)
        self.rows.append({"shard": shard, **{key: "" if value is None else value for key, value in row.items()}})

    def write(self, out: Path) -> None:
        """Write ``index.csv``."""
        table = io.StringIO()
        writer = csv.DictWriter(table, _INDEX_COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.rows)
        write_text(out / "index.csv", table.getvalue())


def describe_row(pair: LoadedPair, split: str) -> dict[str, Any]:
    """Describe a pair by a row of an index, with the names of its columns."""
    depth, camera = pair.depth["left"], pair.pair.camera
    known = np.isfinite(depth)
    occluded = known & ~pair.visible["left"]
    return {
        "key": pair.pair.id,
        "split": split,
        "scene": name_scene(pair.pair),
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "focal_px": camera.focal_px,
        "baseline_m": camera.baseline_m,
        "sun_elevation_deg": _sun_elevation_deg(pair),
        "seed": pair.settings.dataset.seed,
        "depth_median_m": round(float(np.median(depth[known])), 4) if known.any() else None,
        "occluded_share": round(float(occluded.sum() / max(1, known.sum())), 4),
    }


def _sun_elevation_deg(pair: LoadedPair) -> float | None:
    """Return the elevation of the Sun that lit the images, from any source; None if the pair lacks it."""
    return None if pair.pair.sun is None else round(pair.pair.sun.elevation_deg, 4)


def _write_webdataset(each: Each, out: Path) -> None:
    """Write shards ``train-000000.tar`` and so on, ``index.csv``, ``README.md`` and ``croissant.json``.

    A shard has for each pair, by its id, ``left.png``, ``right.png`` (16-bit), ``disparity.png`` (16-bit, 256 steps per
    px, 0 is unknown), ``visible.png`` (255 where both eyes see the point) and ``camera.json``. A scene is in one split.
    Raises IcyMoonError if there are shards already.
    """
    if any(out.glob("*.tar")):
        raise IcyMoonError(
            f"{out} already contains shards, which would mix with the new ones; remove them or choose another folder."
        )
    index, shards = _Index(), _Shards(out)

    def write(pair: LoadedPair) -> list[Loss]:
        steps, losses = quantise_to_16_bits(
            pair.pair.camera.disparity(pair.depth["left"]), KITTI_STEPS_PER_PX, "disparity", "px"
        )
        refuse_losses(pair, losses)
        split = find_split_of_pair(pair.pair)
        index.add(pair, split, shards.add(split, pair.pair.id, _encode_pair_files(pair, steps)))
        return losses

    try:
        each(write)
    except BaseException:
        shards.discard()
        raise
    names = shards.close()
    index.write(out)
    write_text(
        out / "README.md",
        _make_data_card(
            index,
            "WebDataset shards",
            (
                '`wds.WebDataset("train-{000000..N}.tar").decode("pil").to_tuple("left.png", "right.png", '
                '"disparity.png")` reads it. Disparity in px is the value of `disparity.png` divided by 256; 0 '
                "is unknown."
            ),
        ),
    )
    write_json(out / "croissant.json", _make_croissant(out, names))


def _encode_pair_files(pair: LoadedPair, steps: Array) -> dict[str, bytes]:
    """Encode the files of a pair in a shard, by their suffix; ``steps`` are its disparities."""
    top = 2.0**pair.images.bits - 1
    found = {}
    for eye in EYES:
        image = pair.images.seen(eye)
        image = image[..., ::-1] if image.ndim == 3 else image
        found[f"{eye}.png"] = encode_image(np.rint(65535 * (image / top)).astype(np.uint16), ".png")
    found["disparity.png"] = encode_image(steps, ".png")
    found["visible.png"] = encode_image(pair.visible["left"].astype(np.uint8) * 255, ".png")
    camera = pair.pair.camera.rectified
    found["camera.json"] = json.dumps({**camera.to_json(), "scene": name_scene(pair.pair)}).encode()
    return found


class _Shards:
    """Tar files by split, each written under a temporary name and renamed when it is complete."""

    def __init__(self, out: Path) -> None:
        self._out = out
        self._open: dict[str, tuple[str, Path, tarfile.TarFile]] = {}
        self._done: list[str] = []
        self._count: Counter[str] = Counter()

    def add(self, split: str, key: str, files: Mapping[str, bytes]) -> str:
        """Add the files of a pair, and return the name of their shard."""
        if split not in self._open:
            name = f"{split}-{self._count[split]:06d}.tar"
            self._count[split] += 1
            self._out.mkdir(parents=True, exist_ok=True)
            part = make_part_path(self._out / name)
            self._open[split] = (
                name,
                part,
                tarfile.open(  # noqa: SIM115
                    part, "w", format=tarfile.USTAR_FORMAT, encoding="utf-8"
                ),
            )
        name, part, archive = self._open[split]
        with explain_disk_errors("write to", part):  # a broken archive cannot take the next pair
            for suffix, content in files.items():
                member = tarfile.TarInfo(f"{key}.{suffix}")  # without a time: the same pairs give the same bytes
                member.size = len(content)
                archive.addfile(member, io.BytesIO(content))
        if part.stat().st_size > MIN_SHARD_BYTES:
            self._finish_shard(split)
        return name

    def _finish_shard(self, split: str) -> None:
        name, part, archive = self._open.pop(split)
        archive.close()
        replace(part, self._out / name)
        self._done.append(name)

    def discard(self) -> None:
        """Remove the incomplete shards."""
        for _, part, archive in self._open.values():
            with suppress(OSError):  # a full disk cannot take the end of the archive
                archive.close()
            remove(part)
        self._open.clear()

    def close(self) -> list[str]:
        """Close all shards; return their names."""
        for split in list(self._open):
            self._finish_shard(split)
        return sorted(self._done)


def _write_sceneflow(each: Each, out: Path) -> None:
    """Write the layout of SceneFlow's FlyingThings3D, which loaders of stereo networks read unchanged.

    The files are ``<out>/FlyingThings3D/frames_finalpass/TRAIN/A/0000/left/0000.png`` and so on, the same in
    ``frames_cleanpass``, ``disparity/TRAIN/A/0000/left/0000.pfm``, and ``<out>/flyingthings_validation.txt``, the
    disparities of TEST. A folder such as ``0000`` is a scene. Images have 8 bits, unknown disparities are 1e5 px.
    Raises IcyMoonError if the path of ``out`` has a word that loaders replace.
    """
    path = str(out.absolute())
    if word := next((word for word in _REPLACED_WORDS if word in path), ""):
        raise IcyMoonError(
            f"{out}: loaders replace the word {word} wherever it is in a path, so they would not find "
            "the files; choose a folder without it."
        )
    index, root = _Index(), out / "FlyingThings3D"
    numbers: dict[str, Counter[str]] = {}
    folders: dict[str, dict[str, str]] = {"TRAIN": {}, "TEST": {}}
    tested = []

    def write(pair: LoadedPair) -> None:
        scene = name_scene(pair.pair)
        split = "TRAIN" if find_split_of_pair(pair.pair) == "train" else "TEST"
        folder = folders[split].setdefault(scene, f"{len(folders[split]):04d}")
        frame = numbers.setdefault(split, Counter())
        number = f"{frame[folder]:04d}"
        with fill_whole_folder(root) as part:
            for eye in EYES:
                _write_eye(pair, eye, part, f"{split}/A/{folder}/{eye}/{number}")
        frame[folder] += 1
        if split == "TEST":
            tested.append(f"{split}/A/{folder}/left/{number}.pfm")
        index.add(pair, split, f"{split}/A/{folder}/{number}")

    each(write)
    write_text(out / "flyingthings_validation.txt", "".join(f"{line}\n" for line in tested))
    index.write(out)
    write_text(
        out / "README.md",
        _make_data_card(
            index,
            "the layout of SceneFlow's FlyingThings3D",
            (
                "RAFT-Stereo reads `FlyingThings3D` from its folder of data; IGEV-Stereo takes the folder "
                "`FlyingThings3D` "
                "itself for its `sceneflow`."
            ),
        ),
    )


def _write_eye(pair: LoadedPair, eye: str, out: Path, frame: str) -> None:
    """Write the image of an eye, for both passes, and its disparity, each as ``<kind>/<frame>.png`` or ``.pfm``."""
    image = to_8_bit(pair.images.for_files(eye), pair.images.bits, pair.images.encoding)
    content = encode_image(image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=-1), ".png")
    for passed in ("frames_cleanpass", "frames_finalpass"):
        write_bytes(out / passed / f"{frame}.png", content)
    disparity = pair.pair.camera.disparity(pair.depth[eye])
    write_pfm(out / "disparity" / f"{frame}.pfm", np.where(np.isfinite(disparity), disparity, UNKNOWN_DISPARITY_PX))


def _make_data_card(index: _Index, layout: str, how: str) -> str:
    """Make a data card: the content, origin and limits of the data."""
    rows = index.rows
    splits = Counter(row["split"] for row in rows)
    scenes = {split: len({row["scene"] for row in rows if row["split"] == split}) for split in splits}
    table = "".join(f"| {split} | {count} | {scenes[split]} |\n" for split, count in sorted(splits.items()))
    depths = [row["depth_median_m"] for row in rows if row["depth_median_m"] != ""]
    suns = [row["sun_elevation_deg"] for row in rows if row["sun_elevation_deg"] != ""]
    spread = f"The median depths of the pairs range from {min(depths):g} to {max(depths):g} m.\n" if depths else ""
    spread += f"The Sun stands {min(suns):g} to {max(suns):g} degrees above the horizon.\n" if suns else ""
    return (
        f"# Stereo pairs of icy moons\n\nMade by Icy Moon {version()}, a simulator; no image here is a photograph. "
        f"{format_count(len(rows), 'pair')} in {layout}. {how}\n\n| split | pairs | scenes |\n|---|---|---|\n"
        f"{table}\n{spread}\nA scene, the shape of its ground and rocks, is in one split only. Disparity is exact "
        "at pixel centres, left column minus right column; sky has none. `index.csv` lists the pairs. What the "
        "surfaces, the light and the cameras are like, with sources, is in the `pair.json` of the pairs that this "
        "was made of; what the simulator leaves out is in its manual, *Limits*.\n"
    )


def _make_croissant(out: Path, shards: list[str]) -> dict[str, Any]:
    """Make metadata in Croissant 1.0 (mlcommons.org/croissant/1.0): the index as records, the shards as files."""
    fields = [
        {
            "@type": "cr:Field",
            "@id": f"pairs/{name}",
            "name": name,
            "dataType": _COLUMN_TYPES.get(name, "sc:Float"),
            "source": {"fileObject": {"@id": "index.csv"}, "extract": {"column": name}},
        }
        for name in _INDEX_COLUMNS
    ]
    return {
        "@context": _CROISSANT_CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": "icymoon-stereo",
        "description": f"Stereo pairs of icy moons with exact disparity, made by Icy Moon {version()}.",
        "version": "1.0.0",
        "distribution": [
            _file_object(out / "index.csv", "text/csv"),
            *(_file_object(out / name, "application/x-tar") for name in shards),
        ],
        "recordSet": [{"@type": "cr:RecordSet", "@id": "pairs", "name": "pairs", "field": fields}],
    }


def _file_object(path: Path, kind: str) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": path.name,
        "name": path.name,
        "contentUrl": path.name,
        "encodingFormat": kind,
        "sha256": hash_file(path),
    }


WEBDATASET = Export(write_all=_write_webdataset)
SCENEFLOW = Export(write_all=_write_sceneflow)
