"""The user's own files in the settings, with // as the folder of the open .blend file."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...settings import user_files
from ...settings.description import merged
from ...settings.topics.scene import Settings


def _blend_folder() -> str | None:
    return str(Path(bpy.data.filepath).parent) if bpy.data.filepath else None


def used_files(settings: Settings) -> dict[str, Path]:
    """``settings.user_files.find_used_files`` with the folder of the open .blend file."""
    return user_files.find_used_files(settings, _blend_folder())


def with_absolute_files(settings: Settings) -> Settings:
    """The settings with absolute paths of files, for another process, which cannot resolve //."""
    found = [(*name.split("."), str(path)) for name, path in used_files(settings).items()]
    return merged(settings, *({topic: {key: path}} for topic, key, path in found))


def content(settings: Settings) -> str:
    """``settings.user_files.hash_content`` with the folder of the open .blend file."""
    return user_files.hash_content(settings, _blend_folder())


def are_there(settings: Settings) -> bool:
    """``settings.user_files.do_files_exist`` with the folder of the open .blend file."""
    return user_files.do_files_exist(settings, _blend_folder())
