"""What a Blender can do. It is asked before anything is estimated or rendered. Imports no Blender."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from ...physics.scene_requirements import surface_topics
from ...settings.topics.rendering import QualitySettings
from ...settings.topics.scene import Settings
from ...support.errors import IcyMoonError
from ...support.number_text import format_count
from ..workers.job_commands import blender_command
from ..workers.process import Process


@dataclass(frozen=True)
class Abilities:
    """What a Blender has of what settings may need. An official build has all but a graphics card."""

    osl: bool = True
    denoiser: bool = True
    gpu: bool = True


def probe_blender(blender: str) -> dict[str, Any]:
    """What a Blender, or a Python with ``bpy``, reports about itself, see ``render.probe_blender``.

    Raises IcyMoonError if it reports nothing.
    """
    process = Process(blender_command(blender, "probe"))
    for message in process.wait_for_messages():
        if message["type"] == "probe":
            return message
        if message["type"] == "error":
            raise IcyMoonError(message["message"])
    raise IcyMoonError(f"{blender}: {process.cause}")


@lru_cache(maxsize=4)
def ask_abilities(blender: str) -> Abilities:
    """The abilities of a Blender, asked once. Raises IcyMoonError if it reports nothing."""
    facts = probe_blender(blender)
    return Abilities(facts["osl"], facts["denoiser"], bool(facts["devices"]))


def describe_lack_for_quality(quality: QualitySettings, able: Abilities) -> str:
    """A sentence on what a Blender lacks for these quality settings, with the fix; empty if it lacks nothing."""
    if quality.denoiser != "NONE" and not able.denoiser:
        return "This Blender was built without OpenImageDenoise; set quality.denoiser to NONE or use an official build."
    if quality.device == "GPU" and not able.gpu:
        return "Cycles finds no graphics card that it can render on; set quality.device to CPU."
    return ""


def describe_lack(settings: Settings, able: Abilities) -> str:
    """The same, for complete settings."""
    if (
        not able.osl
        and settings.hapke.backend == "OSL"
        and any(settings[topic]["model"] in ("HAPKE", "SNOW") for topic in surface_topics(settings))
    ):
        return (
            "This Blender was built without Open Shading Language; set hapke.backend to AUTO or use an official build."
        )
    return describe_lack_for_quality(settings.quality, able)


def needs_full_build(settings: Settings) -> bool:
    """Whether settings need what not every Blender has."""
    return bool(describe_lack(settings, Abilities(osl=False, denoiser=False, gpu=False)))


def find_lack(wanted: Iterable[Settings], blender: str) -> str:
    """What a Blender lacks for some of these settings, and for how many of them; empty if nothing. It is started
    only if any of them needs what not every Blender has.

    Raises IcyMoonError if it reports nothing.
    """
    asked, count = [], 0
    for settings in wanted:
        count += 1
        if needs_full_build(settings):
            asked.append(settings)
    if not asked:
        return ""
    able = ask_abilities(blender)
    found = [lack for lack in (describe_lack(settings, able) for settings in asked) if lack]
    if not found or count == 1:
        return "".join(found)
    what, fix = found[0].rstrip(".").split("; ", 1)
    return f"{what}, which {len(found)} of {format_count(count, 'pair')} need; {fix}."


def check_abilities(wanted: Iterable[Settings], blender: str) -> None:
    """Raise IcyMoonError if a Blender lacks what some of these settings ask for, or cannot be asked."""
    lack = find_lack(wanted, blender)
    if lack:
        raise IcyMoonError(lack)
