"""Small stereo networks as ONNX files: true block matching, by the operators that networks are made of."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from icymoon.support.arrays import Array
from onnx import TensorProto, helper, numpy_helper

#: Disparities that a network searches.
STEPS = 16
_TYPES = {"float32": TensorProto.FLOAT, "float16": TensorProto.FLOAT16}


def write_network(
    path: Path,
    size: tuple[int, int] | None = None,
    names: Sequence[str] = ("left", "right"),
    channels: int = 3,
    last: bool = False,
    factor: float = 1.0,
    second: bool = False,
    dtype: str = "float32",
    half: bool = False,
    swapped: bool = False,
    constant: float = 0.0,
) -> Path:
    """Write a network that finds disparities of 0 to 15 px times ``factor``, and a ``constant`` more.

    ``size`` is its fixed height and width. With one name, the input has the channels of both images; with four, the
    first two are of half the size and unused but for a zero. ``last``: channels are the last axis. ``second``: there
    is another output before the disparity. ``half``: the disparity has half the size of the images. ``swapped``: the
    file lists the inputs in the opposite order.
    """
    sides: list[Any] = list(size) if size else ["h", "w"]
    nodes: list[Any] = []
    weights: dict[str, Array] = {"zero": np.array(0, dtype)}

    def add(kind: str, inputs: Sequence[str], output: str, **how: Any) -> str:
        nodes.append(helper.make_node(kind, list(inputs), [output], **how))
        return output

    def weight(name: str, values: Any, of: str = dtype) -> str:
        weights[name] = np.asarray(values, of)
        return name

    count = channels * (2 if len(names) == 1 else 1)
    shapes = {name: [1, *sides, count] if last else [1, count, *sides] for name in names}
    eyes = [add("Transpose", [name], f"{name}_first", perm=[0, 3, 1, 2]) if last else name for name in names]
    if len(names) == 1:
        nodes.append(helper.make_node("Split", [eyes[0]], ["eye0", "eye1"], axis=1))
        eyes = ["eye0", "eye1"]
    elif len(names) == 4:
        shapes |= {name: [1, count, *(side // 2 for side in size)] for name in names[:2]} if size else {}
        unused = add("Mul", [add("ReduceMean", [names[0]], "mean", keepdims=0), "zero"], "nothing")
        eyes = [add("Add", [eyes[2], unused], "left_used"), eyes[3]]
    grey = weight("grey", np.full((1, channels, 1, 1), 1 / channels))
    left, right = (add("Conv", [eye, grey], f"grey{k}") for k, eye in enumerate(eyes[:2]))
    axes, ends = weight("axes", [3], "int64"), weight("ends", [2**31], "int64")
    box = weight("box", np.full((1, 1, 5, 5), 1 / 25))
    costs = []
    for d in range(STEPS):
        # What is d to the right of the start of the padded image was at x - d of the right one.
        padded = add("Pad", [right, weight(f"pads{d}", [0, 0, 0, d, 0, 0, 0, 0], "int64")], f"padded{d}", mode="edge")
        width = add(
            "Slice",
            [padded, weight(f"from{d}", [0], "int64"), weight(f"to{d}", [-d], "int64") if d else ends, axes],
            f"shifted{d}",
        )
        wrong = add("Abs", [add("Sub", [left, width], f"difference{d}")], f"wrong{d}")
        costs.append(add("Conv", [wrong, box], f"cost{d}", pads=[2, 2, 2, 2]))
    volume = add("Mul", [add("Concat", costs, "volume", axis=1), weight("sharp", -0.5)], "score")
    shares = add("Softmax", [volume], "shares", axis=1)
    steps = weight("steps", constant + factor * np.arange(STEPS).reshape(1, STEPS, 1, 1))
    found = add("Conv", [shares, steps], "disparity")
    if half:
        found = add("AveragePool", [found], "halved", kernel_shape=[2, 2], strides=[2, 2])
    given = _TYPES[dtype]
    declared: list[tuple[str, list[str | int | None]]] = [(found, [1, 1, "oh", "ow"])]
    if second:
        declared.insert(0, (add("ReduceMean", [shares], "confidence", keepdims=1), [1, 1, 1, 1]))
    listed = names[::-1] if swapped else names
    return _write(
        path,
        nodes,
        [helper.make_tensor_value_info(name, given, shapes[name]) for name in listed],
        [helper.make_tensor_value_info(name, given, shape) for name, shape in declared],
        weights,
    )


def write_channel(path: Path, channel: int) -> Path:
    """Write a network that returns one channel of the left image."""
    weights = {"pick": np.eye(3, dtype=np.float32)[channel].reshape(1, 3, 1, 1)}
    images = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 3, "h", "w"]) for name in ("left", "right")]
    found = helper.make_tensor_value_info("disparity", TensorProto.FLOAT, [1, 1, "h", "w"])
    return _write(path, [helper.make_node("Conv", ["left", "pick"], ["disparity"])], images, [found], weights)


def _write(path: Path, nodes: list[Any], inputs: list[Any], outputs: list[Any], weights: dict[str, Array]) -> Path:
    graph = helper.make_graph(
        nodes, "stereo", inputs, outputs, [numpy_helper.from_array(values, name) for name, values in weights.items()]
    )
    # Older versions of ONNX Runtime refuse files of newer versions of the format.
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())
    return path
