"""Networks as ONNX files: every kind of input and output, and what is said of one that is not as stated."""

import time

import numpy as np
import pytest
from icymoon.stereo.matchers import check_options, complete_options, match
from icymoon.stereo.matchers import onnx as matcher
from icymoon.support.errors import IcyMoonError

pytest.importorskip("onnxruntime", reason="`make test` installs ONNX Runtime")
onnx_networks = pytest.importorskip("onnx_networks", reason="`make test` installs onnx")

SHIFT = 5


def shifted(height, width, shift):
    """A pair of images, BGR as OpenCV reads them, whose disparity is ``shift`` everywhere."""
    random = np.random.default_rng(1)
    coarse = random.integers(0, 128, (height // 4 + 1, (width + shift) // 4 + 1, 3))
    fine = random.integers(0, 128, (height, width + shift, 3))
    image = (fine + np.kron(coarse, np.ones((4, 4, 1)))[:height, : width + shift]).astype(np.uint8)
    return image[:, :width], image[:, shift:]


def found(path, shape=(48, 64), shift=SHIFT, **options):
    """The disparity of a shifted pair away from the borders, and the facts."""
    left, right = shifted(shape[0], shape[1], shift)
    disparity, _, info = match("onnx", left, right, {"model": str(path)} | options)
    assert disparity.shape == shape
    return disparity[8:-8, 24:-8], info["facts"]


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"size": (48, 64)},
        {"names": ("input",), "size": (48, 64)},
        {"names": ("input",)},
        {"channels": 1},
        {"names": ("input",), "channels": 1},
        {"last": True},
        {"names": ("LEFT_image", "image_right"), "swapped": True},
        {"names": ("0", "1")},
        {"dtype": "float16"},
        {"names": ("init_left", "init_right", "next_left", "next_right"), "size": (48, 64)},
    ],
    ids=str,
)
def test_every_kind_of_input_is_served(how, tmp_path):
    path = onnx_networks.write_network(tmp_path / "net.onnx", **how)
    disparity, facts = found(path)
    assert np.abs(disparity - SHIFT).max() < 0.05
    assert (facts["input_height"], facts["input_width"]) == (64, 64) if "size" not in how else (48, 64)
    assert len(facts["checkpoint_sha256"]) == 64


def test_images_of_any_size_are_padded_and_not_resized(tmp_path):
    path = onnx_networks.write_network(tmp_path / "net.onnx")
    disparity, facts = found(path, (45, 71), multiple=16)
    assert np.abs(disparity - SHIFT).max() < 0.05
    assert (facts["input_height"], facts["input_width"]) == (48, 80)


def test_a_fixed_size_scales_the_disparities_by_the_widths(tmp_path):
    """And an expected error: here it is the disparity itself."""
    path = onnx_networks.write_network(tmp_path / "net.onnx", size=(48, 64))
    left, right = shifted(96, 128, 10)
    options = {"model": str(path), "confidence": 0, "confidence_is": "error_px"}
    whole, _, info = match("onnx", left, right, options)
    np.testing.assert_allclose(info["confidence"], np.exp(-whole), rtol=1e-5)
    disparity = whole[8:-8, 24:-8]
    assert np.abs(np.median(disparity) - 10) < 0.1
    assert np.median(np.abs(disparity - 10)) < 0.2
    assert (info["facts"]["input_height"], info["facts"]["input_width"]) == (48, 64)


@pytest.mark.parametrize(
    ("numbers", "values"),
    [
        ("byte", (10, 20, 30)),
        ("unit", (10 / 255, 20 / 255, 30 / 255)),
        ("signed", (10 / 127.5 - 1, 20 / 127.5 - 1, 30 / 127.5 - 1)),
        ("imagenet", ((10 / 255 - 0.485) / 0.229, (20 / 255 - 0.456) / 0.224, (30 / 255 - 0.406) / 0.225)),
    ],
)
@pytest.mark.parametrize("order", ["rgb", "bgr"])
def test_a_network_gets_the_numbers_and_colours_that_are_stated(numbers, values, order, tmp_path):
    """A network that only hands on one channel of the left image shows what it got."""
    for channel in range(3):
        path = onnx_networks.write_channel(tmp_path / "net.onnx", channel)
        image = np.empty((32, 32, 3), np.uint8)
        image[:] = (10, 20, 30)  # RGB
        disparity = matcher.compute(
            image,
            image,
            complete_options(
                "onnx", {"model": str(path), "test": "none", "numbers": numbers, "order": order, "scale": "2"}
            ),
            None,
        ).disparity
        np.testing.assert_allclose(disparity, 2 * values[channel if order == "rgb" else 2 - channel], rtol=1e-5)


def test_networks_with_other_signs_units_and_outputs_are_understood(tmp_path):
    negative = onnx_networks.write_network(tmp_path / "negative.onnx", factor=-1)
    assert np.abs(found(negative, sign="negative")[0] - SHIFT).max() < 0.05
    share = onnx_networks.write_network(tmp_path / "share.onnx", factor=1 / 64)
    assert np.abs(found(share, scale=64)[0] - SHIFT).max() < 0.05
    second = onnx_networks.write_network(tmp_path / "second.onnx", second=True)
    assert np.abs(found(second, output=1)[0] - SHIFT).max() < 0.05


@pytest.mark.ci_takes(4)
@pytest.mark.parametrize(
    ("how", "options", "reason"),
    [
        (
            {"factor": -1},
            {},
            r"finds -7\S* and -12\S* px where the images are shifted by 7 and 12 px; give "
            r"onnx.sign=negative",
        ),
        ({}, {"sign": "negative"}, "give onnx.sign=positive"),
        ({"factor": 0.25}, {}, r"finds 1.75\d* and 3 px .*onnx.scale=4"),
        ({"factor": -0.25}, {}, r"onnx.scale=4 and the other onnx.sign"),
        ({"factor": 0}, {}, "finds 0 and 0 px .*onnx.numbers"),
        # It always answers 31 px, and with the factor 7 / 31 would pass a test by one shift.
        ({"factor": 0, "constant": 31}, {}, r"finds 31 and 31 px .*; look at \S+ \S+ \S+ and onnx.swap\.$"),
        (
            {"factor": 0, "constant": 31},
            {"scale": 7 / 31},
            "finds 7 and 7 px where the images are shifted by 7 and 12 px",
        ),
        ({"factor": 0, "constant": 7}, {}, "finds 7 and 7 px"),
        ({"factor": 0, "constant": 12}, {}, "finds 12 and 12 px"),
        ({"names": ("a", "b"), "swapped": True}, {}, "its inputs seem to be exchanged: give onnx.swap=yes"),
        ({}, {"swap": "yes"}, "its inputs seem to be exchanged: give onnx.swap=no"),
        ({"second": True}, {}, "outputs are confidence 1x1x1x1, disparity 1x1xohxow; choose the one"),
        ({}, {"confidence": 3}, "onnx.confidence is 3, .* the one with the confidence of the whole image"),
        ({}, {"output": 3}, "onnx.output is 3, and the network's outputs are disparity"),
        ({"half": True}, {}, "of the whole image, 384 x 256 px"),
        ({"channels": 2}, {}, "input left 1x2xhxw, which is not a batch of one image or of both"),
        ({"names": ("a", "b", "c", "d")}, {}, "4 inputs without a size"),
        ({"names": ("a", "b", "c")}, {}, "has 3 inputs .*a stereo network has 1, 2 or 4"),
    ],
)
def test_what_is_wrong_is_one_sentence(how, options, reason, tmp_path):
    path = onnx_networks.write_network(tmp_path / "net.onnx", **how)
    for _ in range(2):  # also for the next pair
        with pytest.raises(IcyMoonError, match=reason) as caught:
            found(path, **options)
    assert "\n" not in str(caught.value)


def test_exchanged_inputs_are_served(tmp_path):
    path = onnx_networks.write_network(tmp_path / "net.onnx", names=("a", "b"), swapped=True)
    assert np.abs(found(path, swap="yes")[0] - SHIFT).max() < 0.05


def test_a_file_that_is_no_network_is_one_sentence(tmp_path):
    (tmp_path / "net.onnx").write_bytes(b"no network")
    with pytest.raises(IcyMoonError, match=r"net.onnx cannot be read as an ONNX network \(Load model.*\); export it"):
        found(tmp_path / "net.onnx")
    with pytest.raises(IcyMoonError, match=r"names .*none.onnx, which is not a file"):
        check_options("onnx", {"model": str(tmp_path / "none.onnx")})
    with pytest.raises(IcyMoonError, match=r"onnx.model is empty"):
        check_options("onnx", {})


def write_loop(path, size):
    """Write a network for images of a size (rows, columns) whose loop has no end."""
    onnx, (number, image) = onnx_networks.onnx, (onnx_networks.TensorProto.INT64, onnx_networks.TensorProto.FLOAT)
    helper = onnx.helper

    def value(name, kind=image, shape=None):
        return helper.make_tensor_value_info(name, kind, shape)

    flag = onnx_networks.TensorProto.BOOL
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["on"]), helper.make_node("Identity", ["x"], ["y"])],
        "body",
        [value("k", number, []), value("go", flag, []), value("x")],
        [value("on", flag, []), value("y")],
    )
    graph = helper.make_graph(
        [
            helper.make_node("ReduceMean", ["left"], ["mean"], axes=[1]),
            helper.make_node("Loop", ["most", "true", "mean"], ["out"], body=body),
        ],
        "graph",
        [value(name, image, [1, 3, *size]) for name in ("left", "right")],
        [value("out", image, [1, 1, *size])],
        [onnx.numpy_helper.from_array(np.array(2**62), "most"), onnx.numpy_helper.from_array(np.array(True), "true")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    path.write_bytes(model.SerializeToString())
    return path


@pytest.mark.parametrize(("size", "seconds"), [((240, 320), 1), ((200, 1000), 2)])
def test_a_network_without_end_is_stopped_after_a_time_in_proportion_to_its_input(tmp_path, capfd, size, seconds):
    """After ``timeout_s`` for up to 0.1 megapixels, twice that for 0.2; and it is not tried again for the next pair."""
    path, begun = write_loop(tmp_path / "loop.onnx", size), time.monotonic()
    for _ in range(2):
        with pytest.raises(
            IcyMoonError,
            match=rf"stopped after {seconds} s for {size[1]} x {size[0]} px; if it "
            r"is only slow, give a larger onnx.timeout_s than 1;",
        ):
            found(path, timeout_s=1)
    assert seconds <= time.monotonic() - begun < 2 * seconds + 2  # a second of starting, on a busy machine
    assert "onnxruntime" not in capfd.readouterr().err


def test_a_file_that_changed_is_read_again(tmp_path):
    path = onnx_networks.write_network(tmp_path / "net.onnx", factor=-1)
    with pytest.raises(IcyMoonError, match=r"onnx.sign"):
        found(path)
    onnx_networks.write_network(path)
    assert np.abs(found(path)[0] - SHIFT).max() < 0.05
