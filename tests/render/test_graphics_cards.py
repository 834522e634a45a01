"""Cards are selected in Cycles as they are chosen. Cycles is stood in for: what it reports needs the cards."""

from types import SimpleNamespace

import bpy
import pytest
from icymoon.errors import IcyMoonError
from icymoon.operators import jobs
from icymoon.render import graphics_cards
from icymoon.render.workers.cards import ENVIRONMENT, Cards


class FakeCycles:
    """The preferences of Cycles on a machine with two NVIDIA cards, which OptiX and CUDA both know."""

    def __init__(self):
        self._type = "NONE"
        self.devices = [SimpleNamespace(name=name, type=kind, use=True) for kind, name in (
            ("CUDA", "A"), ("CUDA", "B"), ("OPTIX", "A"), ("OPTIX", "B"), ("CPU", "Processor"))]

    @property
    def compute_device_type(self):
        return self._type

    @compute_device_type.setter
    def compute_device_type(self, kind):
        if kind not in ("NONE", "CUDA", "OPTIX"):
            raise TypeError(kind)
        self._type = kind

    def get_devices_for_type(self, kind):
        return [device for device in self.devices if device.type in (kind, "CPU")]

    def used(self):
        return [(device.type, device.name) for device in self.devices if device.use]


@pytest.fixture
def cycles(monkeypatch):
    preferences = FakeCycles()
    add_ons = {"cycles": SimpleNamespace(preferences=preferences)}
    context = SimpleNamespace(preferences=SimpleNamespace(addons=add_ons))
    monkeypatch.setattr(graphics_cards, "bpy", SimpleNamespace(context=context, types=bpy.types))
    monkeypatch.delenv(ENVIRONMENT, raising=False)
    return preferences


@pytest.mark.parametrize(("chosen", "names", "used"), [
    ("", ["0: A", "1: B"], [("OPTIX", "A"), ("OPTIX", "B")]), ("1", ["1: B"], [("OPTIX", "B")]),
    ("CUDA:0", ["0: A"], [("CUDA", "A")]), ("0,1", ["0: A", "1: B"], [("OPTIX", "A"), ("OPTIX", "B")])])
def test_the_chosen_cards_and_no_processor_are_selected(cycles, monkeypatch, chosen, names, used):
    monkeypatch.setenv(ENVIRONMENT, chosen)
    assert graphics_cards.select_cards() == names
    assert cycles.used() == used
    assert graphics_cards.list_selected_cards() == [name for _, name in used]


@pytest.mark.parametrize("chosen", ["2", "HIP:0"])
def test_a_card_that_cycles_does_not_find_is_an_error(cycles, monkeypatch, chosen):
    monkeypatch.setenv(ENVIRONMENT, chosen)
    with pytest.raises(IcyMoonError, match="There is no graphics card"):
        graphics_cards.select_cards()


def test_without_cards_there_are_none_to_select(cycles):
    cycles.devices = cycles.devices[-1:]
    assert graphics_cards.select_cards() == []
    assert cycles.compute_device_type == "NONE"


@pytest.mark.parametrize(("kind", "ticked", "found"), [
    ("OPTIX", "B", Cards("OPTIX", (1,))), ("CUDA", "AB", Cards("CUDA", (0, 1))), ("OPTIX", "", Cards()),
    ("NONE", "AB", Cards())])
def test_the_window_uses_what_is_ticked_in_the_preferences(cycles, kind, ticked, found):
    cycles.compute_device_type = kind
    for device in cycles.devices:
        device.use = device.name in ticked
    assert graphics_cards.find_ticked_cards() == found
    environment = jobs.environment_with_cards("GPU", {"A": "b"})
    assert environment == ({"A": "b", ENVIRONMENT: str(found)} if found.numbers else {"A": "b"})
    assert jobs.environment_with_cards("CPU", {"A": "b"}) == {"A": "b"}


def test_the_environment_comes_before_what_is_ticked(cycles, monkeypatch):
    cycles.compute_device_type = "OPTIX"
    monkeypatch.setenv(ENVIRONMENT, "0")
    assert jobs.environment_with_cards("GPU", {"A": "b"}) == {"A": "b"}
