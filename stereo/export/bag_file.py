"""Writes pairs and scans as bags of ROS 2 messages."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ...support.errors import IcyMoonError
from ...support.files import explain_disk_errors, make_part_path
from ...support.system import remove_folder, replace

#: Frame of the site's axes.
WORLD_FRAME = "map"


def check() -> str:
    """Return the reason why no bag can be written here; empty if it can."""
    if importlib.util.find_spec("rosbags") is None:
        return 'The export ros2 needs the package rosbags; pip install "icymoon[ros]".'
    return ""


@contextmanager
def open_bag(bag: Path) -> Iterator[tuple[Callable[[str, Any, int], None], Any]]:
    """Open a new bag (MCAP), which exists once the ``with`` block ends.

    Yield a function that adds a message to a topic at a time in ns, and rosbags' types of messages. Raises IcyMoonError
    if there is a bag already, or if the disk refuses.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    if bag.exists():
        raise IcyMoonError(f"{bag} exists already, and a bag is not overwritten; remove it or choose another folder.")
    types = get_typestore(Stores.ROS2_JAZZY)
    part = make_part_path(bag)
    with explain_disk_errors("write to", part):
        part.mkdir(parents=True)
    try:
        # In a separate folder, because a bag has the name of its folder.
        with Writer(part / bag.name, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            known: dict[str, Any] = {}

            def add(topic: str, message: Any, time: int) -> None:
                with explain_disk_errors("write to", part):
                    if topic not in known:
                        known[topic] = writer.add_connection(topic, message.__msgtype__, typestore=types)
                    writer.write(known[topic], time, types.serialize_cdr(message, message.__msgtype__))

            yield add, types
        replace(part / bag.name, bag)
    finally:
        remove_folder(part)
