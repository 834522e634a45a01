"""Packets of waveforms on the disk."""

from __future__ import annotations

import errno
import struct

import numpy as np
import pytest
from icymoon.formats.wave_packets import FACTS_SHAPE, PacketWriter, check_packets
from icymoon.physics.lidar.digitiser import Digitiser
from icymoon.support.errors import IcyMoonError
from icymoon.support.file_schemas import check_record

DIGITISER = Digitiser(64, 500, 0.25)


def write(folder, batches):
    with PacketWriter(folder, DIGITISER) as writer:
        for samples, gain in batches:
            writer.add(samples, gain)
        return writer.finish()


def test_packets_follow_a_header_of_las(tmp_path):
    samples = np.arange(192, dtype=np.uint16).reshape(3, 64) + 300
    none = np.zeros((0, 64), np.uint16), np.zeros(0, np.uint8)
    facts = write(
        tmp_path / "new", [(samples[:2], np.array([0, 2], np.uint8)), none, (samples[2:], np.ones(1, np.uint8))]
    )
    content = (tmp_path / "new" / "lidar.wdp").read_bytes()
    # Reserved, user id, record id, length after the header, description: 60 bytes in all.
    assert struct.unpack_from("<H16sHQ", content) == (0, b"LASF_Spec".ljust(16, b"\0"), 65535, 3 * 128)
    assert np.array_equal(np.frombuffer(content[60:], "<u2").reshape(3, 64), samples)
    assert facts == {
        "packets": 3,
        "samples": 64,
        "spacing_ps": 500,
        "bits": 16,
        "zero": 4096,
        "step_electrons": 0.25,
        "gains": 3,
    }
    check_record(dict(facts), FACTS_SHAPE, tmp_path, "scan again")
    check_packets(tmp_path / "new", facts)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["lidar.wdp"]


def test_a_scan_without_a_packet_has_a_header_only(tmp_path):
    facts = write(tmp_path, [])
    assert (facts["packets"], facts["gains"]) == (0, 0)
    assert (tmp_path / "lidar.wdp").stat().st_size == 60
    check_packets(tmp_path, facts)


def test_a_scan_that_fails_keeps_the_earlier_packets(tmp_path):
    (tmp_path / "lidar.wdp").write_bytes(b"earlier")
    with PacketWriter(tmp_path, DIGITISER) as writer:
        writer.add(np.zeros((1, 64), np.uint16), np.zeros(1, np.uint8))
    assert [path.name for path in tmp_path.iterdir()] == ["lidar.wdp"]
    assert (tmp_path / "lidar.wdp").read_bytes() == b"earlier"


def test_a_full_disk_is_one_sentence(tmp_path, monkeypatch):
    class Full:
        def write(self, content):
            raise OSError(errno.ENOSPC, "No space left on device")

    with PacketWriter(tmp_path, DIGITISER) as writer:
        monkeypatch.setattr(writer, "_stream", Full())
        with pytest.raises(IcyMoonError, match=r"lidar\.wdp: the disk is full; free some space"):
            writer.add(np.zeros((1, 64), np.uint16), np.zeros(1, np.uint8))
    assert not list(tmp_path.iterdir())


def test_missing_and_cut_packets_are_one_sentence(tmp_path):
    facts = write(tmp_path, [(np.zeros((2, 64), np.uint16), np.zeros(2, np.uint8))])
    path = tmp_path / "lidar.wdp"
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(IcyMoonError, match=r"has 315 bytes, and its scan has written 316; scan the scene again"):
        check_packets(tmp_path, facts)
    path.unlink()
    with pytest.raises(IcyMoonError, match=r"lidar.wdp is missing; scan the scene again"):
        check_packets(tmp_path, facts)
