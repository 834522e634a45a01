"""A landed day over ROS 2. A planner sends steps, and gets images, the map of sites and numbers.

In a sourced ROS 2 with icymoon in its Python:

    icymoon-landed-day-ros --number 3 --method sgbm
    ros2 topic pub --once /lander/step std_msgs/msg/String "{data: '{\\"action\\": \\"look\\"}'}"
"""

from __future__ import annotations

import argparse
import json
from array import array
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

import icymoon
import numpy as np

if TYPE_CHECKING:
    from icymoon.stereo.landed_day.day import LandedDay, Observation

#: Makers of messages by their names.
Kinds = Mapping[str, Callable[..., Any]]

STEPS, NUMBERS, ERRORS, SITES = "/lander/step", "/lander/observation", "/lander/error", "/lander/sites"
IMAGES = {"left": "/stereo/left/image_rect", "right": "/stereo/right/image_rect"}
#: The message of each topic that goes out.
OUT = {
    NUMBERS: "std_msgs/msg/String",
    ERRORS: "std_msgs/msg/String",
    SITES: "nav_msgs/msg/OccupancyGrid",
    **dict.fromkeys(IMAGES.values(), "sensor_msgs/msg/Image"),
}
_KEYS, _LONGEST_STEP = ("action", "hours", "site"), 10_000
_SECONDS_PER_HOUR = 3600.0
_NS_PER_S = 1_000_000_000


class Exchange:
    """Steps of a day come in as JSON, messages go out by ``publish(topic, message)``."""

    def __init__(self, day: LandedDay, kinds: Kinds, publish: Callable[[str, Any], None]) -> None:
        self._day, self._kinds, self._publish = day, kinds, publish

    def do_step(self, text: str) -> None:
        """Do the step in a text such as {"action": "wait", "hours": 3} and publish what the lander knows then; or
        publish the reason why it cannot be done.
        """
        try:
            seen = self._day.step(**_parse_step(text))
        except icymoon.IcyMoonError as error:
            self._publish(ERRORS, self._kinds[OUT[ERRORS]](data=str(error)))
            return
        for topic, message in make_messages(seen, self._kinds):
            self._publish(topic, message)


def _parse_step(text: str) -> dict[str, Any]:
    """The arguments of ``LandedDay.step``. Raises IcyMoonError for a text that has none."""
    try:
        step = json.loads(text) if len(text) <= _LONGEST_STEP else None
    except (ValueError, RecursionError):
        step = None
    if not isinstance(step, dict) or not isinstance(step.get("action"), str) or not {*step} <= {*_KEYS}:
        raise icymoon.IcyMoonError(
            f'{STEPS} is no step; send JSON such as {{"action": "wait", "hours": 3}} or {{"action": "choose", '
            '"site": [4, 7]}.'
        )
    hours, site = step.get("hours", 0.0), step.get("site")
    if not _is_number(hours):
        raise icymoon.IcyMoonError(f"{STEPS} has hours that are no number; send hours above 0.")
    if site is not None and not (isinstance(site, list) and len(site) == 2 and all(type(at) is int for at in site)):
        raise icymoon.IcyMoonError(f"{STEPS} has a site that is no cell; send its row and column as whole numbers.")
    return {"action": step["action"], "hours": float(hours), "site": None if site is None else tuple(site)}


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9


def make_messages(seen: Observation, kinds: Kinds) -> Iterator[tuple[str, Any]]:
    """(topic, message) of an observation: its numbers, and after a look both images and the map of sites."""
    yield NUMBERS, kinds[OUT[NUMBERS]](data=json.dumps(seen.to_json()))
    time = round(seen.hours * _SECONDS_PER_HOUR * _NS_PER_S)
    stamp = kinds["builtin_interfaces/msg/Time"](sec=time // _NS_PER_S, nanosec=time % _NS_PER_S)
    for eye, topic in IMAGES.items():
        pixels = getattr(seen, eye)
        if pixels is not None:
            header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=f"stereo_{eye}_optical")
            yield topic, make_image(pixels, kinds, header)
    if seen.margin is not None:
        yield SITES, make_site_map(seen, kinds, kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="site"), stamp)


def make_image(pixels: np.ndarray[Any, Any], kinds: Kinds, header: Any) -> Any:
    """The message of an image, uint8 (H, W)."""
    rows, columns = pixels.shape
    data = np.ascontiguousarray(pixels, np.uint8).ravel()
    return kinds["sensor_msgs/msg/Image"](
        header=header, height=rows, width=columns, encoding="mono8", is_bigendian=0, step=columns, data=data
    )


def make_site_map(seen: Observation, kinds: Kinds, header: Any, stamp: Any) -> Any:
    """The map of sites as ROS has it, from the south upward: 0 is the best site, 100 one that fails a rule, and -1 a
    cell of unknown suitability.
    """
    margin, grid = seen.margin, seen.grid
    assert margin is not None
    assert grid is not None
    known = np.where(np.isfinite(margin), 100 * (1 - np.clip(margin, 0.0, 1.0)), -1.0)
    origin = kinds["geometry_msgs/msg/Pose"](
        position=kinds["geometry_msgs/msg/Point"](x=grid.west_m, y=grid.north_m - grid.rows * grid.cell_m, z=0.0),
        orientation=kinds["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
    )
    info = kinds["nav_msgs/msg/MapMetaData"](
        map_load_time=stamp, resolution=grid.cell_m, width=grid.columns, height=grid.rows, origin=origin
    )
    data = np.rint(known[::-1]).astype(np.int8).ravel()
    return kinds["nav_msgs/msg/OccupancyGrid"](header=header, info=info, data=data)


class RosKinds(dict[str, Callable[..., Any]]):
    """Makers of the messages of a sourced ROS by names such as std_msgs/msg/String."""

    def __missing__(self, name: str) -> Callable[..., Any]:
        package, _, kind = name.split("/")
        found = getattr(import_module(f"{package}.msg"), kind)

        def make(**fields: Any) -> Any:
            # ROS takes arrays of Python, and refuses those of NumPy.
            return found(**{key: _as_array(value) for key, value in fields.items()})

        return make


def _as_array(value: Any) -> Any:
    return array(value.dtype.char, value.tobytes()) if isinstance(value, np.ndarray) else value


def main() -> None:
    """Run a node until it is interrupted."""
    import rclpy

    parser = argparse.ArgumentParser(description="A landed day of Icy Moon over ROS 2.")
    parser.add_argument("--number", type=int, default=0, help="number of the ground")
    parser.add_argument("--seed", type=int, default=0, help="seed of all grounds")
    parser.add_argument("--method", default="sgbm", help="the lander's matcher")
    options, others = parser.parse_known_args()
    rclpy.init(args=others)
    node, kinds = rclpy.create_node("landed_day"), RosKinds()
    publishers = {topic: node.create_publisher(kinds[kind], topic, 10) for topic, kind in OUT.items()}
    with icymoon.open_landed_day(options.number, options.seed, options.method) as day:
        exchange = Exchange(day, kinds, lambda topic, message: publishers[topic].publish(message))
        node.create_subscription(kinds["std_msgs/msg/String"], STEPS, lambda step: exchange.do_step(step.data), 10)
        rclpy.spin(node)
