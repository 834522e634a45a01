"""Stand-ins as files: made once, in the cache folder of Icy Moon, and checked at every use.

Each stand-in has a folder. ``made.json`` is written last, with the checksum of every file: only with it is a folder
whole. A file that was changed, cut off or removed since is made again.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..formats.ply import encode_triangles
from ..formats.png import encode_png
from ..settings.topics.stand_ins import MeshItem, TextureItem, find_mesh_item, find_texture_item
from ..support.arrays import Array
from ..support.cache_folder import FOLDER_VARIABLE, own_cache_folder
from ..support.errors import DiskError, IcyMoonError
from ..support.file_schemas import COUNT, FILE_NAME, NUMBER, SHA256, Each, read_record
from ..support.files import PART_SUFFIX, explain_disk_errors, hash_file, hash_file_once, write_bytes, write_json
from ..support.srgb import to_srgb
from ..support.system import remove
from .reconstructions import reconstruct
from .shown_items import RECIPE_NUMBER
from .texture_maps import make_maps

_RECORD_FILE = "made.json"
#: Shape of the record of a folder; ``height_m`` is the relief of a texture's height image in metres, 0 for a mesh.
_RECORD_SHAPE = {"recipe": COUNT, "height_m": NUMBER, "sha256": Each(SHA256, FILE_NAME)}
_LEFTOVER_AGE_S = 3600.0  # after which a part is a leftover of a process that was killed


def find_folder(item: TextureItem | MeshItem) -> Path:
    """The folder of the files of a stand-in, which may be missing."""
    return own_cache_folder() / "stand_ins" / str(RECIPE_NUMBER) / item.stem


def find_texture_files(key: str) -> dict[str, Path]:
    """The images of a stand-in texture that the paper's texture has, by kind; made if missing.

    Raises IcyMoonError if the cache folder cannot be written to.
    """
    item = find_texture_item(key)
    folder = make_files(item)
    return {kind: folder / f"{item.stem}_{kind}.png" for kind in item.kinds}


def find_mesh_file(key: str) -> Path:
    """The mesh of a stand-in, a PLY file with its image beside it; made if missing.

    Raises IcyMoonError if the cache folder cannot be written to.
    """
    item = find_mesh_item(key)
    return make_files(item) / f"{item.stem}.ply"


def make_files(item: TextureItem | MeshItem, folder: Path | None = None) -> Path:
    """Make the files of a stand-in, unless they are complete, and return their folder: the cache, or ``folder``.

    Raises IcyMoonError if the folder cannot be written to.
    """
    there = folder or find_folder(item)
    if not _is_whole(there, item):
        try:
            _write_all(there, *(_encode_texture(item) if isinstance(item, TextureItem) else _encode_mesh(item)))
        except DiskError as error:
            if folder is not None:
                raise
            raise IcyMoonError(
                f"{str(error).rstrip('.')} (stand-ins are kept in the cache folder, which "
                f"{FOLDER_VARIABLE} or the preference Cache names)."
            ) from error
    return there


def read_relief_m(folder: Path) -> float:
    """Height in metres of white above black in the height image of a folder of ``make_files``."""
    return float(read_record(folder / _RECORD_FILE, _RECORD_SHAPE, "delete it")["height_m"])


def _is_whole(folder: Path, item: TextureItem | MeshItem) -> bool:
    suffixes = [f"_{kind}.png" for kind in item.kinds] if isinstance(item, TextureItem) else [".ply", ".png"]
    try:
        record = read_record(folder / _RECORD_FILE, _RECORD_SHAPE, "delete it")
        return (
            record["recipe"] == RECIPE_NUMBER
            and record["sha256"].keys() >= {item.stem + end for end in suffixes}
            and all(hash_file_once(folder / name) == known for name, known in record["sha256"].items())
        )
    except (OSError, IcyMoonError):
        return False


def _write_all(folder: Path, height_m: float, encoded: Mapping[str, bytes]) -> None:
    with explain_disk_errors("write to", folder):
        folder.mkdir(parents=True, exist_ok=True)
        for part in folder.glob(f"*{PART_SUFFIX}"):
            with suppress(OSError):
                if time.time() - part.stat().st_mtime > _LEFTOVER_AGE_S:
                    remove(part)
        remove(folder / _RECORD_FILE)  # it is about to become untrue
    for name, data in encoded.items():
        write_bytes(folder / name, data)
    write_json(
        folder / _RECORD_FILE,
        {"recipe": RECIPE_NUMBER, "height_m": height_m, "sha256": {name: hash_file(folder / name) for name in encoded}},
    )


def _encode_texture(item: TextureItem) -> tuple[float, dict[str, bytes]]:
    maps = make_maps(item.key)
    low, span = float(maps.height_m.min()), float(np.ptp(maps.height_m))
    images: dict[str, Array | None] = {
        "albedo": _to_8_bit_levels(to_srgb(maps.albedo)),
        "roughness": _to_8_bit_levels(maps.roughness),
        "normal": _to_8_bit_levels((maps.normal + 1.0) / 2.0),
        "height": np.rint((maps.height_m - low) / span * 65535.0).astype(np.uint16),
        "transmission": None if maps.transmission is None else _to_8_bit_levels(maps.transmission),
    }
    return span, {
        f"{item.stem}_{kind}.png": encode_png(image[::-1], 6) for kind, image in images.items() if image is not None
    }


def _encode_mesh(item: MeshItem) -> tuple[float, dict[str, bytes]]:
    made = reconstruct(item.key)
    image = f"{item.stem}.png"
    comments = ("made by Icy Moon, no reconstruction", f"stand-in for {item.paper}", f"TextureFile {image}")
    return 0.0, {
        image: encode_png(_to_8_bit_levels(to_srgb(made.image))[::-1], 6),
        f"{item.stem}.ply": encode_triangles(
            ("x", "y", "z", "s", "t"), np.hstack([made.positions, made.uv]), made.faces, comments
        ),
    }


def _to_8_bit_levels(values: Array) -> Array:
    """Values from 0 to 1 as levels of 8 bits."""
    return np.rint(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)
