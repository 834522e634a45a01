"""Checks the features of a Blender before a plan is estimated or rendered. Imports no Blender."""

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
    """Optional features of a Blender that settings may need. An official build has all of them except a graphics
    card."""

    osl: bool = True
    denoiser: bool = True
    gpu: bool = True


def probe_blender(blender: str) -> dict[str, Any]:
    """Return the report of a Blender, or of a Python with ``bpy``, about itself: the output of
    ``render/probe_blender.py``.

    Raises IcyMoonError if there is no report.
    """
    process = Process(blender_command(blender, "probe"))
    for message in process.wait_for_messages():
        if message["type"] == "probe":
            return message
        if message["type"] == "error":
            raise IcyMoonError(message["message"])
    raise IcyMoonError(f"{blender}: {process.cause}")


@lru_cache(maxsize=4)
def query_abilities(blender: str) -> Abilities:
    """Ask a Blender for its abilities; each Blender is asked once. Raises IcyMoonError if it reports nothing."""
    facts = probe_blender(blender)
    return Abilities(facts["osl"], facts["denoiser"], bool(facts["devices"]))


def explain_unavailable_quality(quality: QualitySettings, able: Abilities) -> str:
    """Explain in a sentence, with the fix, why a Blender cannot render these quality settings; empty if it can."""
    if quality.denoiser != "NONE" and not able.denoiser:
        return "This Blender was built without OpenImageDenoise; set quality.denoiser to NONE or use an official build."
    if quality.device == "GPU" and not able.gpu:
        return "Cycles finds no graphics card that it can render on; set quality.device to CPU."
    return ""


def describe_lack(settings: Settings, able: Abilities) -> str:
    """Describe in a sentence, with the fix, a feature that a Blender lacks for these complete settings; empty if it
    lacks nothing."""
    if (
        not able.osl
        and settings.hapke.backend == "OSL"
        and any(settings[topic]["model"] in ("HAPKE", "SNOW") for topic in surface_topics(settings))
    ):
        return (
            "This Blender was built without Open Shading Language; set hapke.backend to AUTO or use an official build."
        )
    return explain_unavailable_quality(settings.quality, able)


def needs_full_build(settings: Settings) -> bool:
    """Return whether settings need a feature that some builds of Blender lack."""
    return bool(describe_lack(settings, Abilities(osl=False, denoiser=False, gpu=False)))


def find_missing_feature(wanted: Iterable[Settings], blender: str) -> str:
    """Find a feature that a Blender lacks for some of these settings. Return a sentence with the number of these
    settings; empty if it lacks nothing. Blender is started only if some of the settings need an optional feature.

    Raises IcyMoonError if Blender reports nothing.
    """
    asked, count = [], 0
    for settings in wanted:
        count += 1
        if needs_full_build(settings):
            asked.append(settings)
    if not asked:
        return ""
    able = query_abilities(blender)
    found = [lack for lack in (describe_lack(settings, able) for settings in asked) if lack]
    if not found or count == 1:
        return "".join(found)
    what, fix = found[0].rstrip(".").split("; ", 1)
    return f"{what}, which {len(found)} of {format_count(count, 'pair')} need; {fix}."


def check_abilities(wanted: Iterable[Settings], blender: str) -> None:
    """Raise IcyMoonError if a Blender lacks a feature that some of these settings need, or if it does not answer."""
    lack = find_missing_feature(wanted, blender)
    if lack:
        raise IcyMoonError(lack)
