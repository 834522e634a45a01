"""The verb ``stand-ins``: items made by code in place of the files of the GUISS paper, as a list or as files."""

from __future__ import annotations

import argparse

from ..paper_stand_ins.cached_files import make_files, read_relief_m
from ..paper_stand_ins.shown_items import MESH_IMAGE_SIDE_PX, TEXTURE_SIDE_PX
from ..settings.topics.stand_ins import MESHES, TEXTURES, MeshItem, TextureItem
from ..support.errors import IcyMoonError
from ..support.printer import say
from ..support.suggestions import suggest_nearest
from ..support.terminal import as_path, parse_list_option


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``stand-ins``."""
    parser.add_argument("names", nargs="*", metavar="NAME", help="stand-ins such as powder_snow (all)")
    parser.add_argument("--out", type=as_path, metavar="FOLDER", help="write their files here, each into a folder")
    parser.set_defaults(run=_run_stand_ins)


def _find_items(names: list[str]) -> list[TextureItem | MeshItem]:
    known = {item.stem: item for item in (*TEXTURES, *MESHES)}
    for name in names:
        if name.lower() not in known:
            raise IcyMoonError(f"There is no stand-in {name!r}, {suggest_nearest(name.lower(), known)}")
    return [known[name.lower()] for name in names] or list(known.values())


def _run_stand_ins(options: argparse.Namespace) -> int:
    for item in _find_items(parse_list_option(options.names)):
        if options.out is None:
            say(_describe_item(item))
            continue
        folder = make_files(item, options.out.absolute() / item.stem)
        height = f", height image of {read_relief_m(folder):.4g} m" if isinstance(item, TextureItem) else ""
        say(f"{folder}: {_describe_size(item)}{height}")
    return 0


def _describe_size(item: TextureItem | MeshItem) -> str:
    if isinstance(item, TextureItem):
        return f"{item.width_m:g} m wide, {TEXTURE_SIDE_PX} pixels"
    return (
        f"{item.size_m:g} m wide, about {item.triangles} triangles, {item.holes} holes, "
        f"image of {MESH_IMAGE_SIDE_PX} pixels"
    )


def _describe_item(item: TextureItem | MeshItem) -> str:
    return f"{item.stem:22} {item.title}, {_describe_size(item)}; in place of {item.paper}: {item.known}"
