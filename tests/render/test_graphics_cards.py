"""Cards are selected in Cycles as they are chosen, and their first use is told of. Cycles is stood in for: what it
reports needs the cards."""

import threading
import time
from types import SimpleNamespace
from typing import cast

import bpy
import pytest
from icymoon.operators import jobs
from icymoon.render import graphics_cards, worker
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.scene_source import FixedScene
from icymoon.render.workers import first_use_of_card
from icymoon.render.workers.assign_cards import ENVIRONMENT, Cards
from icymoon.render.workers.shared_light import SharedLight
from icymoon.support.errors import IcyMoonError
from rendering import complete


class FakeCycles:
    """The preferences of Cycles on a machine with two NVIDIA cards, which OptiX and CUDA both know."""

    def __init__(self):
        self._type = "NONE"
        self.devices = [
            SimpleNamespace(name=name, type=kind, use=True)
            for kind, name in (("CUDA", "A"), ("CUDA", "B"), ("OPTIX", "A"), ("OPTIX", "B"), ("CPU", "Processor"))
        ]

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


@pytest.mark.parametrize(
    ("chosen", "names", "used"),
    [
        ("", ["0: A", "1: B"], [("OPTIX", "A"), ("OPTIX", "B")]),
        ("1", ["1: B"], [("OPTIX", "B")]),
        ("CUDA:0", ["0: A"], [("CUDA", "A")]),
        ("0,1", ["0: A", "1: B"], [("OPTIX", "A"), ("OPTIX", "B")]),
    ],
)
def test_the_chosen_cards_and_no_processor_are_selected(cycles, monkeypatch, chosen, names, used):
    monkeypatch.setenv(ENVIRONMENT, chosen)
    assert graphics_cards.select_cards() == names
    assert cycles.used() == used
    assert graphics_cards.list_selected_cards() == [name for _, name in used]


@pytest.mark.parametrize("chosen", ["2", "HIP:0"])
def test_a_card_that_cycles_does_not_find_is_an_error(cycles, monkeypatch, chosen):
    monkeypatch.setenv(ENVIRONMENT, chosen)
    with pytest.raises(IcyMoonError, match="Cycles finds no graphics card"):
        graphics_cards.select_cards()


def test_without_cards_there_are_none_to_select(cycles):
    cycles.devices = cycles.devices[-1:]
    assert graphics_cards.select_cards() == []
    assert cycles.compute_device_type == "NONE"


@pytest.mark.parametrize(
    ("kind", "ticked", "found"),
    [
        ("OPTIX", "B", Cards("OPTIX", (1,))),
        ("CUDA", "AB", Cards("CUDA", (0, 1))),
        ("OPTIX", "", Cards()),
        ("NONE", "AB", Cards()),
    ],
)
def test_the_window_uses_what_is_ticked_in_the_preferences(cycles, kind, ticked, found):
    cycles.compute_device_type = kind
    for device in cycles.devices:
        device.use = device.name in ticked
    assert graphics_cards.find_selected_cards() == found
    environment = jobs.make_environment_with_cards("GPU", {"A": "b"})
    assert environment == ({"A": "b", ENVIRONMENT: str(found)} if found.numbers else {"A": "b"})
    assert jobs.make_environment_with_cards("CPU", {"A": "b"}) == {"A": "b"}


def test_the_environment_comes_before_what_is_ticked(cycles, monkeypatch):
    cycles.compute_device_type = "OPTIX"
    monkeypatch.setenv(ENVIRONMENT, "0")
    assert jobs.make_environment_with_cards("GPU", {"A": "b"}) == {"A": "b"}


class FakeSource:
    """Scenes that are built at once."""

    rays = object()

    def prepare(self, planned):
        return None, None, 0.0


def rendered_by_a_fake(monkeypatch, tmp_path, device, headings=1):
    """The messages about pairs. The light of the first is baked until two of them have told that a driver may be
    compiling, or for ten of the intervals between these, as all takes that comes after its first sample."""
    heard = []

    def compiling():
        return [facts for _, facts in heard if "compiling" in facts.get("message", "")]

    def bake(built, scene, planned, shared):
        until = time.monotonic() + (60.0 if device == "GPU" else 0.1)
        while len(compiling()) < 2 and time.monotonic() < until:
            time.sleep(0.01)

    def render_pair(built, scene, planned, dataset, seconds_build, report, *others):
        report(0.5)
        time.sleep(0.1)

    monkeypatch.setattr(first_use_of_card, "REPORT_INTERVAL_S", 0.01)
    monkeypatch.setattr(worker, "render_pair", render_pair)
    monkeypatch.setattr(worker.baked_light, "provide_baked_light", bake)
    monkeypatch.setattr(SharedLight, "release_stated_light", lambda *arguments: time.sleep(0.1))
    pairs = expand_headings(complete({"quality": {"device": device}, "dataset": {"headings": headings}}))
    worker.render_from(
        cast(FixedScene, FakeSource()), pairs, tmp_path, lambda kind, **facts: heard.append((kind, facts))
    )
    return heard


def test_a_worker_tells_that_a_driver_may_be_compiling_until_the_first_sample(monkeypatch, tmp_path):
    heard = rendered_by_a_fake(monkeypatch, tmp_path, "GPU", headings=2)
    told = [k for k, (kind, facts) in enumerate(heard) if "compiling" in facts.get("message", "")]
    first_sample = next(k for k, (kind, facts) in enumerate(heard) if facts.get("of_pair") == 0.5)
    assert len(told) > 1
    assert all(k < first_sample for k in told)
    for k in told:  # the runner takes it for what it hears of the pair
        kind, facts = heard[k]
        assert (kind, facts["pair"], facts["fraction"], facts["of_pair"]) == ("progress", heard[0][1]["pair"], 0.0, 0.0)
    assert [kind for kind, _ in heard].count("pair") == 2


def test_a_processor_compiles_nothing(monkeypatch, tmp_path):
    heard = rendered_by_a_fake(monkeypatch, tmp_path, "CPU")
    assert not [facts for _, facts in heard if "compiling" in facts.get("message", "")]


def test_a_worker_that_hangs_becomes_silent(monkeypatch):
    monkeypatch.setattr(first_use_of_card, "REPORT_INTERVAL_S", 0.01)
    monkeypatch.setattr(first_use_of_card, "_MAX_COMPILING_S", 0.0)
    told = []
    with first_use_of_card.report_while_compiling(first_use_of_card.FirstSample(), lambda: told.append(1)):
        time.sleep(0.2)
    assert told == []


def test_nothing_is_told_after_a_pair_has_failed(monkeypatch):
    monkeypatch.setattr(first_use_of_card, "REPORT_INTERVAL_S", 0.01)
    told = []
    with (
        pytest.raises(IcyMoonError),
        first_use_of_card.report_while_compiling(first_use_of_card.FirstSample(), lambda: told.append(1)),
    ):
        raise IcyMoonError("It failed.")
    before = len(told)
    time.sleep(0.1)
    assert len(told) == before


def test_no_report_ends_after_the_first_sample():
    first_sample, told = first_use_of_card.FirstSample(), []
    begun = threading.Event()

    def tell():
        begun.set()
        time.sleep(0.05)
        told.append(first_sample.has_come)

    thread = threading.Thread(target=first_sample.call_until_it_comes, args=(tell, 0.001, 60.0))
    thread.start()
    assert begun.wait(60.0)
    first_sample.note()
    before = len(told)
    thread.join()
    assert before >= 1
    assert told == [False] * before
