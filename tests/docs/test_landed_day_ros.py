"""The example that lives a landed day over ROS 2: its messages as ROS stores them, and what a planner may send."""

from __future__ import annotations

import importlib
import json
import sys
from array import array
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from icymoon.stereo.decisions.dem import Grid
from icymoon.stereo.landed_day.day import Observation
from icymoon.support.errors import IcyMoonError
from icymoon.support.version import ROOT
from rosbags.typesys import Stores, get_typestore

TYPES: Any = get_typestore(Stores.ROS2_JAZZY)
LEFT = np.arange(12, dtype=np.uint8).reshape(3, 4)
SEEN = Observation(
    3,
    1.5,
    20.0,
    30.0,
    looks=1,
    left=LEFT,
    right=LEFT + 100,
    grid=Grid(0.5, 2, 3, 10.0, 20.0),
    margin=np.array([[1.0, 0.25, -0.5], [np.nan, 0.0, 0.5]]),
    best=(0, 0),
    best_margin=1.0,
)


@pytest.fixture
def example(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "examples" / "icymoon-landed-day-ros"))
    yield importlib.import_module("icymoon_landed_day_ros")
    sys.modules.pop("icymoon_landed_day_ros", None)


class Day:
    """A day that notes its steps."""

    def __init__(self):
        self.steps = []

    def step(self, action, hours, site):
        if action == "dig":
            raise IcyMoonError("Nothing can be dug; choose a site first.")
        self.steps.append((action, hours, site))
        return SEEN


def run(example, text):
    """The steps that a text from a planner makes, and the messages by topic."""
    day, out = Day(), {}
    example.Exchange(day, TYPES.types, out.__setitem__).do_step(text)
    return day.steps, out


def test_messages_are_read_back_as_ros_stores_them(example):
    found = {}
    for topic, message in example.make_messages(SEEN, TYPES.types):
        kind = message.__msgtype__
        assert kind == example.OUT[topic]
        found[topic] = TYPES.deserialize_cdr(TYPES.serialize_cdr(message, kind), kind)
    left, right = (found[topic] for topic in example.IMAGES.values())
    assert (left.data.reshape(left.height, left.width) == LEFT).all()
    assert (right.data.reshape(right.height, right.step) == LEFT + 100).all()
    assert (left.header.stamp.sec, left.header.stamp.nanosec) == (5400, 0)
    assert json.loads(found[example.NUMBERS].data)["best"] == [0, 0]
    # ROS counts rows from the south: 100 fails a rule, -1 is unknown.
    assert found[example.SITES].data.reshape(2, 3).tolist() == [[-1, 100, 50], [0, 75, 100]]
    origin = found[example.SITES].info.origin.position
    assert (origin.x, origin.y) == (10.0, 19.0)


def test_before_a_look_there_are_only_numbers(example):
    assert [topic for topic, _ in example.make_messages(Observation(0, 0.0, 0.0, 1.0), TYPES.types)] == [
        example.NUMBERS
    ]


@pytest.mark.parametrize(
    ("text", "step"),
    [
        ('{"action": "look"}', ("look", 0.0, None)),
        ('{"action": "wait", "hours": 3}', ("wait", 3.0, None)),
        ('{"action": "choose", "site": [4, 7]}', ("choose", 0.0, (4, 7))),
    ],
)
def test_a_step_of_a_planner_is_done(example, text, step):
    steps, out = run(example, text)
    assert steps == [step]
    assert {*out} == {*example.OUT} - {example.ERRORS}


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "is no step"),
        ("look", "is no step"),
        ("[1]", "is no step"),
        ('{"hours": 3}', "is no step"),
        ('{"action": 3}', "is no step"),
        ('{"action": "look", "speed": 1}', "is no step"),
        ("[" * 9000, "is no step"),
        (json.dumps({"action": "x" * 20_000}), "is no step"),
        ('{"action": "wait", "hours": "3"}', "hours that are no number"),
        ('{"action": "wait", "hours": true}', "hours that are no number"),
        ('{"action": "wait", "hours": NaN}', "hours that are no number"),
        ('{"action": "choose", "site": 4}', "no cell"),
        ('{"action": "choose", "site": [4.5, 7]}', "no cell"),
        ('{"action": "dig"}', "choose a site first"),
    ],
)
def test_what_is_no_step_gets_one_sentence(example, text, why):
    steps, out = run(example, text)
    assert not steps
    assert [*out] == [example.ERRORS]
    assert why in out[example.ERRORS].data


def test_a_node_takes_steps_and_publishes_arrays_of_python(example, monkeypatch):
    """With stand-ins for rclpy and its messages, which refuse arrays of NumPy as ROS does."""

    class Message:
        def __init__(self, **fields):
            assert not any(isinstance(value, np.ndarray) for value in fields.values())
            self.__dict__.update(fields)

    class Node:
        published, steps = [], None

        def create_publisher(self, kind, topic, depth):
            class Publisher:
                def publish(self, message):
                    Node.published.append((topic, message))

            return Publisher()

        def create_subscription(self, kind, topic, callback, depth):
            Node.steps = callback

    for package in {name.split("/")[0] for name in TYPES.types}:
        messages: Any = ModuleType(f"{package}.msg")
        messages.__getattr__ = lambda name: Message
        monkeypatch.setitem(sys.modules, package, ModuleType(package))
        monkeypatch.setitem(sys.modules, f"{package}.msg", messages)
    ros: Any = ModuleType("rclpy")
    ros.init, ros.create_node = lambda args: None, lambda name: Node()
    ros.spin = lambda node: Node.steps(Message(data='{"action": "look"}'))
    monkeypatch.setitem(sys.modules, "rclpy", ros)
    monkeypatch.setattr(sys, "argv", ["icymoon-landed-day-ros", "--method", "bm"])
    example.main()
    published = dict(Node.published)
    assert {*published} == {*example.OUT} - {example.ERRORS}
    image = published[example.IMAGES["left"]]
    assert isinstance(image.data, array)
    assert (image.data.typecode, len(image.data)) == ("B", image.height * image.width)
