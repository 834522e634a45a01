"""The user's own files in the settings, with // as the folder of the open .blend file."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...settings import user_files
from ...settings.description import merged
from ...settings.topics.scene import Settings


def _find_blend_folder() -> str | None:
    return str(Path(bpy.data.filepath).parent) if bpy.data.filepath else None


def find_used_files(settings: Settings) -> dict[str, Path]:
    """Call ``settings.user_files.find_used_files`` with the folder of the open .blend file."""
    return user_files.find_used_files(settings, _find_blend_folder())


def make_paths_absolute(settings: Settings) -> Settings:
    """Return the settings with absolute paths of files, for another process, which cannot resolve //."""
    found = [(*name.split("."), str(path)) for name, path in find_used_files(settings).items()]
    return merged(settings, *({topic: {key: path}} for topic, key, path in found))


def hash_content(settings: Settings) -> str:
    """Call ``settings.user_files.hash_content`` with the folder of the open .blend file."""
    return user_files.hash_content(settings, _find_blend_folder())


def do_files_exist(settings: Settings) -> bool:
    """Call ``settings.user_files.do_files_exist`` with the folder of the open .blend file."""
    return user_files.do_files_exist(settings, _find_blend_folder())
