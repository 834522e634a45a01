"""What a Blender can do, asked of itself before anything is promised or rendered. Imports no Blender."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from ...errors import IcyMoonError
from ...physics.left_out import surface_topics
from ...settings.description import Settings
from ..workers.job import blender_command
from ..workers.process import Process


@dataclass(frozen=True)
class Abilities:
    """What a Blender has of what settings may ask for; an official build has all, but a graphics card."""

    osl: bool = True
    denoiser: bool = True
    gpu: bool = True


def probe(blender: str) -> dict[str, Any]:
    """What a Blender, or a Python with ``bpy``, says of itself, see ``render.probe``.

    Raises IcyMoonError if it says nothing.
    """
    process = Process(blender_command(blender, "probe"))
    for message in process.messages():
        if message["type"] == "probe":
            return message
        if message["type"] == "error":
            raise IcyMoonError(message["message"])
    raise IcyMoonError(f"{blender}: {process.last_words}")


@lru_cache(maxsize=4)
def ask(blender: str) -> Abilities:
    """The abilities of a Blender, asked once. Raises IcyMoonError if it says nothing."""
    facts = probe(blender)
    return Abilities(facts["osl"], facts["denoiser"], bool(facts["devices"]))


def lacking_quality(quality: Mapping[str, Any], able: Abilities) -> str:
    """What a Blender lacks for settings of the quality, with the mend, as a sentence; empty if nothing."""
    if quality["denoiser"] != "NONE" and not able.denoiser:
        return ("This Blender was built without OpenImageDenoise; set quality.denoiser to NONE or use an official "
                "build.")
    if quality["device"] == "GPU" and not able.gpu:
        return "Cycles finds no graphics card that it can render on; set quality.device to CPU."
    return ""


def lacking(settings: Settings, able: Abilities) -> str:
    """The same, for complete settings."""
    if not able.osl and settings["hapke"]["backend"] == "OSL" and any(
            settings[topic]["model"] == "HAPKE" for topic in surface_topics(settings)):
        return ("This Blender was built without Open Shading Language; set hapke.backend to AUTO or use an official "
                "build.")
    return lacking_quality(settings["quality"], able)


def special(settings: Settings) -> bool:
    """Whether settings ask for what not every Blender has."""
    return bool(lacking(settings, Abilities(osl=False, denoiser=False, gpu=False)))


def lacking_of(wanted: Iterable[Settings], blender: str) -> str:
    """What a Blender lacks for some of these settings, and for how many; empty if nothing. It is asked only if any of
    them asks for what not every Blender has.

    Raises IcyMoonError if it says nothing.
    """
    asked, count = [], 0
    for settings in wanted:
        count += 1
        if special(settings):
            asked.append(settings)
    if not asked:
        return ""
    able = ask(blender)
    found = [lack for lack in (lacking(settings, able) for settings in asked) if lack]
    if not found or count == 1:
        return "".join(found)
    what, mend = found[0].rstrip(".").split("; ", 1)
    return f"{what}, which {len(found)} of {count} pairs ask for; {mend}."


def require(wanted: Iterable[Settings], blender: str) -> None:
    """Raise IcyMoonError if a Blender lacks what some of these settings ask for, or cannot be asked."""
    lack = lacking_of(wanted, blender)
    if lack:
        raise IcyMoonError(lack)
