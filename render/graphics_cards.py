"""The graphics cards that Cycles renders on in this Blender."""

from __future__ import annotations

from typing import Any

import bpy

from .workers.assign_cards import BACKENDS, Cards, choose_card_numbers, read_chosen_cards


def select_cards() -> list[str]:
    """Select the graphics cards that Cycles is to render on, and return the index and name of each, such as "0: Name".

    The cards are the ones that ``read_chosen_cards`` names, or all. They and their backend are selected in the
    preferences of this session only. Raises IcyMoonError if a chosen card is missing.
    """
    add_on = bpy.context.preferences.addons.get("cycles")
    if add_on is None:
        return []
    chosen = read_chosen_cards()
    cycles = add_on.preferences
    for backend in (chosen.backend,) if chosen.backend else BACKENDS:
        found = _list_cards(cycles, backend)
        if found:
            numbers = choose_card_numbers(chosen, [card.name for card in found])
            for device in cycles.devices:
                device.use = False
            for number in numbers:
                found[number].use = True
            return [f"{number}: {found[number].name}" for number in numbers]
    cycles.compute_device_type = "NONE"
    choose_card_numbers(chosen, [])
    return []


def list_selected_cards() -> list[str]:
    """List the names of the graphics cards that ``select_cards`` has selected in this session."""
    add_on = bpy.context.preferences.addons.get("cycles")
    if add_on is None:
        return []
    cycles = add_on.preferences
    return [device.name for device in cycles.devices if device.use and device.type == cycles.compute_device_type]


def _list_cards(cycles: bpy.types.AddonPreferences, backend: str) -> list[Any]:
    """Select a backend and list its cards; empty if this build of Blender lacks the backend."""
    try:
        cycles.compute_device_type = backend
    except TypeError:
        return []
    return [device for device in cycles.get_devices_for_type(backend) if device.type == backend]


def find_selected_cards() -> Cards:
    """Find the graphics cards that the user has ticked in the preferences of Blender; empty for no card and for all
    cards."""
    add_on = bpy.context.preferences.addons.get("cycles")
    backend = getattr(add_on.preferences, "compute_device_type", "NONE") if add_on else "NONE"
    if add_on is None or backend not in BACKENDS:
        return Cards()
    found = [device for device in add_on.preferences.get_devices_for_type(backend) if device.type == backend]
    ticked = tuple(number for number, device in enumerate(found) if device.use)
    return Cards(backend, ticked) if ticked else Cards()
