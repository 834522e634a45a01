"""Files of networks from strangers: no code of theirs runs, and each is refused in one sentence, in bounded memory."""

from __future__ import annotations

import io
import os
import pickle
import resource
import struct
import time
import zipfile

import numpy as np
import pytest
from icymoon.stereo.matchers import match
from icymoon.support.errors import IcyMoonError

torch = pytest.importorskip("torch", reason="`make test` installs PyTorch")
onnx = pytest.importorskip("onnx", reason="`make test` installs onnx")
learned = pytest.importorskip("icymoon.stereo.matchers.network_matchers")
IMAGE = np.random.default_rng(0).integers(0, 256, (48, 64, 3)).astype(np.uint8)


class _Code:
    """What a pickle runs when it is loaded."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def saved(data, **options):
    stream = io.BytesIO()
    torch.save(data, stream, **options)
    return stream.getvalue()


def packed(data):
    """The archive again, its members packed."""
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as new:
        for member in old.infolist():
            new.writestr(member.filename, old.read(member))
    return stream.getvalue()


def opcodes(text):
    return b"\x80\x02" + text + b"."


WEIGHTS = saved({"a": torch.zeros(3)})
CHECKPOINTS = {
    "empty": b"",
    "text": b"no checkpoint",
    "cut": WEIGHTS[:-30],
    "half": WEIGHTS[: len(WEIGHTS) // 2],
    "bomb": packed(saved({"a": torch.zeros(10**6)})),
    "no dictionary": saved([torch.zeros(3)]),
    "numbers": saved({"a": 3}),
    "nested": saved({"state_dict": {"a": {"b": torch.zeros(3)}}}),
    "deep": opcodes(b"]" * 10**5),
    "system": opcodes(b"cos\nsystem\n(S'touch x'\ntR"),
    "global": opcodes(b"cbuiltins\neval\n(S'1'\ntR"),
    "getattr": opcodes(b"cbuiltins\ngetattr\n(cos\n\nS'system'\ntR"),
    "long": opcodes(b"\x8b" + struct.pack("<i", 2**31 - 1)),
    "bytes": opcodes(b"\x8e" + struct.pack("<Q", 2**40)),
    "negative": opcodes(b"\x8b" + struct.pack("<i", -5)),
    "put": opcodes(b"]r" + struct.pack("<I", 2**32 - 1)),
    "zip without data": b"PK\x05\x06" + bytes(18),
    "sparse": None,
    "huge storage": saved({"a": torch.zeros(3)}, _use_new_zipfile_serialization=False).replace(
        b"K\x03", b"J\xff\xff\xff\x7f"
    ),
}


def refused(act, reason=""):
    begun = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(IcyMoonError) as caught:
        act()
    assert len(str(caught.value).splitlines()) == 1
    assert reason in str(caught.value)
    assert time.process_time() - begun[0] < 5
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - begun[1] < 300_000  # KiB


@pytest.mark.parametrize("name", CHECKPOINTS)
def test_a_checkpoint_that_is_none_is_refused(name, tmp_path):
    file = tmp_path / "a.pth"
    file.write_bytes(CHECKPOINTS[name] or b"PK\x03\x04")
    if name == "sparse":
        os.truncate(file, 10**10)
    refused(lambda: learned.read_parameters(file), "unfolds to 4 MB" if name == "bomb" else "")


@pytest.mark.parametrize("zipped", [True, False])
def test_no_code_of_a_checkpoint_runs(zipped, tmp_path):
    for k, data in enumerate(
        (
            pickle.dumps(_Code(tmp_path / "ran")),
            saved({"a": _Code(tmp_path / "ran")}, _use_new_zipfile_serialization=zipped),
        )
    ):
        (tmp_path / f"{k}.pth").write_bytes(data)
        refused(lambda k=k: learned.read_parameters(tmp_path / f"{k}.pth"))
    assert not (tmp_path / "ran").exists()


def test_a_whole_checkpoint_is_read_as_before(tmp_path):
    for zipped in (True, False):
        (tmp_path / "a.pth").write_bytes(saved({"module.a": torch.arange(3.0)}, _use_new_zipfile_serialization=zipped))
        assert learned.read_parameters(tmp_path / "a.pth")["a"].tolist() == [0, 1, 2]


# ONNX


def network(nodes, tensors=(), size=(48, 64)):
    kinds = onnx.TensorProto
    inputs = [onnx.helper.make_tensor_value_info(name, kinds.FLOAT, [1, 3, *size]) for name in ("left", "right")]
    output = onnx.helper.make_tensor_value_info("out", kinds.FLOAT, None)
    graph = onnx.helper.make_graph(nodes, "g", inputs, [output], list(tensors))
    return onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=9)


def outside(location, dims=(1, 3, 48, 64), **more):
    """A tensor whose numbers are in another file."""
    tensor = onnx.TensorProto(
        name="w", data_type=onnx.TensorProto.FLOAT, dims=dims, data_location=onnx.TensorProto.EXTERNAL
    )
    for key, value in {"location": location, **more}.items():
        tensor.external_data.add(key=key, value=str(value))
    return tensor


ADD = [onnx.helper.make_node("Add", ["left", "w"], ["out"])]
LIE = onnx.TensorProto(name="w", data_type=onnx.TensorProto.FLOAT, dims=[10**6, 10**6], raw_data=b"1234")
NEGATIVE = onnx.TensorProto(name="w", data_type=onnx.TensorProto.FLOAT, dims=[-5], raw_data=bytes(20))
SAME = [onnx.helper.make_node("Identity", ["left"], ["out"])]
NETWORKS = {
    "above": network(ADD, [outside("../secret.bin")]),
    "absolute": network(ADD, [outside("/dev/zero")]),
    "link": network(ADD, [outside("link.bin")]),
    "absent": network(ADD, [outside("absent.bin")]),
    "itself": network(ADD, [outside("net.onnx", offset=-5)]),
    "lie": network(ADD, [LIE]),
    "short": network(ADD, [outside("short.bin", length=10**12)]),
    "negative": network(ADD, [NEGATIVE]),
    "wide": network(SAME, size=(10**5, 10**5)),
    "text": b"no network",
    "empty": b"",
    "huge": None,
    "unknown": network([onnx.helper.make_node("Evil", ["left"], ["out"], domain="evil.com")]),
    "circle": network(
        [onnx.helper.make_node("Add", ["a", "left"], ["out"]), onnx.helper.make_node("Identity", ["out"], ["a"])]
    ),
    "cut": network(SAME).SerializeToString()[:-40],
    "shape": network([onnx.helper.make_node("Shape", ["left"], ["out"])]),
}


@pytest.mark.parametrize("name", NETWORKS)
def test_an_onnx_file_that_is_no_network_of_ours_is_refused(name, tmp_path):
    pytest.importorskip("onnxruntime")
    np.ones(3 * 48 * 64, "<f4").tofile(tmp_path / "secret.bin")
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    (folder / "short.bin").write_bytes(b"1234")
    data = NETWORKS[name]
    file = folder / "net.onnx"
    file.write_bytes(data if isinstance(data, bytes) else b"\x08\x09" if data is None else data.SerializeToString())
    if data is None:
        os.truncate(file, 10**10)
    refused(lambda: match("onnx", IMAGE, IMAGE, {"model": str(file)}))
