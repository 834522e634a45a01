"""Any stereo network as one ONNX file, by ONNX Runtime.

``model`` is the file. The network gets both images: as two inputs, named after left and right or in this order, as one
input with the channels of both, or as four inputs of two sizes. Its output is the disparity of the left image. For an
input of fixed size the images are resized, and the disparities are scaled back; for one of free size they are padded to
a ``multiple``. Before the first pair, the network matches a texture that is shifted by 7 and by 12 px. This test finds
a wrong sign or scale, exchanged inputs, and a network that always gives the same answer.
"""

from __future__ import annotations

import importlib.util
import re
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import hash_file, parse_path
from .options import Option
from .result import CONFIDENCE, CONFIDENCE_KINDS, ERROR_PX, Confidence, Result

if TYPE_CHECKING:
    import onnxruntime

SET_UP = (2, "model", "ONNX Network", "A network in an ONNX file")
COLOUR = True

OPTIONS = (
    Option("model", "", "The ONNX file"),
    Option(
        "numbers",
        "byte",
        "Numbers of the images that the network expects: byte 0 to 255, unit 0 to 1, signed -1 "
        "to 1, imagenet with the mean and spread of ImageNet",
        choices=("byte", "unit", "signed", "imagenet"),
    ),
    Option(
        "order",
        "rgb",
        "Order of the colours that the network expects; one with one channel gets grey anyway",
        choices=("rgb", "bgr"),
    ),
    Option("multiple", 32, "Images are padded to a multiple of this, px, if their size is free", 1, 1024),
    Option(
        "sign",
        "positive",
        "Sign of the network's disparities; RAFT-Stereo has negative ones",
        choices=("positive", "negative"),
    ),
    Option(
        "swap",
        "no",
        "Whether the network gets the right image as the left one, and the left one as the right",
        choices=("no", "yes"),
    ),
    Option("scale", 1.0, "Factor from the network's numbers to px of the image that it gets", 1e-6, 1e6),
    Option("output", 0, "Which output is the disparity, from 0", 0, 99),
    Option("confidence", -1, "Which output is the confidence of the disparity, from 0; -1 for none", -1, 99),
    Option(
        "confidence_is",
        CONFIDENCE,
        "What this output states: a confidence from 0 to 1, an expected error in the units of the disparity, or the "
        "logit of a confidence",
        choices=CONFIDENCE_KINDS,
    ),
    Option(
        "test",
        "shift",
        "What is checked before the first pair: that the network finds shifts of 7 and 12 px",
        choices=("shift", "none"),
    ),
    Option(
        "device",
        "auto",
        "Where the network runs; auto takes CUDA if ONNX Runtime has it",
        choices=("auto", "cpu", "cuda"),
    ),
    Option("threads", 1, "Number of processor cores used", 1, 1024),
    Option(
        "timeout_s",
        60,
        "Seconds after which it is stopped, for an input of up to 0.1 megapixels; a larger one gets as many times more",
        1,
        86400,
    ),
)

PRESETS: dict[str, dict[str, Any]] = {}

#: Requirement for pip: the first version with wheels for NumPy 2, and the next major version.
REQUIREMENT = "onnxruntime>=1.19,<2"
#: Shifts of the test texture. Two are needed, because a constant answer fits one shift with some factor.
_SHIFTS_PX = (7, 12)
#: Most pixels of an input of fixed size, to which images are resized.
_MAX_INPUT_PIXELS = 2**25
#: Pixels of an input that may take ``timeout_s``; the test's input has fewer.
_TIMED_PIXELS = 100_000
_TEST_SHAPE = 256, 384
#: Tolerances of the test: of the median disparity, px, and of the ratio of two disparities, as a share.
_TOLERANCE_PX, _TOLERANCE_SHARE = 1.0, 0.15
#: Mean and spread of the colours of ImageNet.
_IMAGENET_MEAN, _IMAGENET_SPREAD = (
    np.array(values, np.float32) for values in ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
)
_NUMPY_TYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(uint8)": np.uint8,
    "tensor(double)": np.float64,
}


@dataclass(frozen=True)
class _Input:
    """An input of a network, and the image or images that it takes."""

    name: str
    eyes: tuple[str, ...]
    dtype: type
    channels_last: bool
    channels: int  # number of channels of one image
    height: int | None  # None where it is free
    width: int | None


@dataclass(frozen=True)
class _Network:
    """A network that is ready to run."""

    session: onnxruntime.InferenceSession
    inputs: tuple[_Input, ...]
    facts: dict[str, Any]

    @property
    def fixed(self) -> tuple[int, int] | None:
        """Height and width of the largest input; None if they are free."""
        sizes = [(each.height, each.width) for each in self.inputs if each.height and each.width]
        return max(sizes) if sizes else None


def check(options: dict[str, Any]) -> None:
    """Raise IcyMoonError unless the file and ONNX Runtime exist."""
    path = _find_model_path(options)
    if not path.is_file():
        raise IcyMoonError(f"onnx.model names {path}, which is not a file; correct it.")
    require_runtime("onnx")


def require_runtime(method: str) -> None:
    """Raise IcyMoonError without ONNX Runtime, which ``method`` needs."""
    if importlib.util.find_spec("onnxruntime") is None:
        raise IcyMoonError(f'{method} needs ONNX Runtime, which this Python lacks; run: pip install "{REQUIREMENT}"')


def load(options: dict[str, Any]) -> None:
    """Read the file and test the network once for all runs with the same options."""
    _load_network(options)


def compute(left: Array, right: Array, options: dict[str, Any], camera: StereoCamera | None) -> Result:
    """Compute the disparity of uint8 RGB (H, W, 3) images, everywhere."""
    network = _load_network(options)
    return _run_network(network, left, right, options)


def _find_model_path(options: dict[str, Any]) -> Path:
    return parse_path(options["model"], "onnx.model")


def _load_network(options: dict[str, Any]) -> _Network:
    changed = _find_model_path(options).stat()
    loaded = _load_tested_network(tuple(options.items()), (changed.st_mtime_ns, changed.st_size))
    if isinstance(loaded, str):
        raise IcyMoonError(loaded)
    return loaded


@lru_cache(maxsize=4)
def _load_tested_network(items: tuple[tuple[str, Any], ...], changed: tuple[int, int]) -> _Network | str:
    """Load and test the network that these complete options describe. Return it, or a sentence on its fault.
    ``changed`` identifies the version of the file.
    """
    options = dict(items)
    try:
        network = _open_network(options)
        if options["test"] == "shift":
            _test_network(network, options)
    except IcyMoonError as error:  # the fault is kept too, or the test would run again for each pair
        return str(error)
    return network


def open_session(
    method: str, path: Path, device: str, threads: int
) -> tuple[onnxruntime.InferenceSession, dict[str, Any]]:
    """Open a network file; return a session that is ready to run, and facts for the provenance. ``device`` is auto, cpu
    or cuda.

    Raises IcyMoonError if there is no such device or the file cannot be read.
    """
    import onnxruntime

    there = onnxruntime.get_available_providers()
    if device == "cuda" and "CUDAExecutionProvider" not in there:
        raise IcyMoonError(
            f"{method}.device is cuda, but this ONNX Runtime runs on the processor only; install "
            "onnxruntime-gpu instead of onnxruntime, or use cpu."
        )
    providers = ["CPUExecutionProvider"]
    if device != "cpu" and "CUDAExecutionProvider" in there:
        providers.insert(0, "CUDAExecutionProvider")
    settings = onnxruntime.SessionOptions()
    settings.intra_op_num_threads, settings.inter_op_num_threads = threads, 1
    settings.log_severity_level = 4  # errors are raised anyway, and warnings are about the export of the network
    onnxruntime.disable_telemetry_events()
    try:
        session = onnxruntime.InferenceSession(str(path), settings, providers=providers)
    except Exception as error:  # its errors have no common base
        raise IcyMoonError(
            f"{path} cannot be read as an ONNX network ({find_first_line(error)}); export it again."
        ) from None
    return session, {
        "checkpoint_sha256": hash_file(path),
        "onnxruntime": onnxruntime.__version__,
        "device": session.get_providers()[0].removesuffix("ExecutionProvider").lower(),
    }


def _open_network(options: dict[str, Any]) -> _Network:
    path = _find_model_path(options)
    session, facts = open_session("onnx", path, options["device"], options["threads"])
    return _Network(session, _find_inputs(path, session.get_inputs()), facts)


def _find_inputs(path: Path, declared: Sequence[Any]) -> tuple[_Input, ...]:
    """Find the images that each input of a network takes. Raises IcyMoonError if the inputs are ambiguous."""
    if len(declared) not in (1, 2, 4):
        raise IcyMoonError(
            f"{path} has {len(declared)} inputs ({_describe_declared(declared)}); a stereo network has 1, 2 or "
            "4: export it with these."
        )
    return tuple(_read_input(path, each, k, len(declared)) for k, each in enumerate(declared))


def _read_input(path: Path, declared: onnxruntime.NodeArg, place: int, count: int) -> _Input:
    shape = [size if isinstance(size, int) and size > 0 else None for size in declared.shape]
    known = len(shape) == 4 and shape[0] in (1, None) and declared.type in _NUMPY_TYPES
    both = 2 if count == 1 else 1
    allowed = (1 * both, 3 * both)
    last = known and shape[1] not in allowed and shape[3] in allowed
    channels = (shape[3] if last else shape[1]) if known else None
    if channels not in allowed:
        raise IcyMoonError(
            f"{path} has the input {_describe_declared([declared])}, which is not a batch of one image or of both; "
            "export it with inputs of 1 or 3 channels each."
        )
    height, width = shape[1:3] if last else shape[2:]
    if count == 4 and not (height and width):
        raise IcyMoonError(
            f"{path} has 4 inputs without a size ({_describe_declared([declared])}); export it with fixed sizes."
        )
    if (height or 1) * (width or 1) > _MAX_INPUT_PIXELS:
        raise IcyMoonError(
            f"{path} has the input {_describe_declared([declared])}, but at most {_MAX_INPUT_PIXELS} pixels are "
            "supported; export it with smaller inputs."
        )
    name = declared.name.lower()
    eye = next((eye for eye in ("left", "right") if eye in name), ("left", "right")[place % 2])
    return _Input(
        declared.name,
        ("left", "right") if count == 1 else (eye,),
        _NUMPY_TYPES[declared.type],
        bool(last),
        channels // both,
        height,
        width,
    )


def _run_network(network: _Network, left: Array, right: Array, options: dict[str, Any]) -> Result:
    height, width = left.shape[:2]
    multiple = options["multiple"]
    run_shape = network.fixed or (height + -height % multiple, width + -width % multiple)
    images = {"left": left, "right": right} if options["swap"] == "no" else {"left": right, "right": left}
    if network.fixed is None:
        images = {
            eye: np.pad(image, ((0, run_shape[0] - height), (0, run_shape[1] - width), (0, 0)), mode="edge")
            for eye, image in images.items()
        }
    outputs = _compute_outputs(network, images, run_shape, options)
    factor = options["scale"] * (-1 if options["sign"] == "negative" else 1)
    find = partial(_find_map, network, outputs, (height, width), run_shape)
    kind = options["confidence_is"]
    confidence = None
    if options["confidence"] >= 0:
        stated = find("confidence", options["confidence"], abs(factor) if kind == ERROR_PX else None)
        confidence = Confidence(stated, kind)
    return Result(
        find("output", options["output"], factor),
        facts={**network.facts, "input_height": run_shape[0], "input_width": run_shape[1]},
        confidence=confidence,
    )


def _find_map(
    network: _Network,
    outputs: Sequence[Array],
    shape: tuple[int, int],
    run_shape: tuple[int, int],
    option: str,
    place: int,
    factor: float | None,
) -> Array:
    """Find the map in an output, in the size of the images. ``factor`` converts it to px of the network's input; None
    for numbers that are not in px.
    """
    found = _select_output_map(network, outputs, place, option, run_shape).astype(np.float32)
    if factor is not None:
        found = found * np.float32(factor)
    if network.fixed is None:
        return found[: shape[0], : shape[1]]
    if network.fixed == shape:
        return found
    resized = np.asarray(cv2.resize(found, shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32)
    return resized if factor is None else resized * np.float32(shape[1] / run_shape[1])


def _compute_outputs(
    network: _Network, images: dict[str, Array], shape: tuple[int, int], options: dict[str, Any]
) -> list[Array]:
    """Compute all outputs of the network for images of its input's ``shape``. Raises IcyMoonError if the
    network fails.
    """
    given = {each.name: _make_input_tensor(each, images, options) for each in network.inputs}
    most_s = find_most_s(options["timeout_s"], shape[0] * shape[1])
    try:
        return run_bounded(network.session, given, most_s)
    except TimeoutError:
        raise IcyMoonError(
            f"onnx.model {_find_model_path(options).name} was stopped after {most_s:.0f} s for {shape[1]} x "
            f"{shape[0]} px; if it is only slow, give a larger onnx.timeout_s than "
            f"{options['timeout_s']:g}; if it contains an endless loop, export it again without the loop."
        ) from None
    except Exception as error:  # its errors have no common base
        raise IcyMoonError(
            f"onnx.model {_find_model_path(options).name} failed in ONNX Runtime ({find_first_line(error)}); try "
            f"onnx.multiple, {options['multiple']}, onnx.device=cpu or smaller images."
        ) from None


def _make_input_tensor(each: _Input, images: dict[str, Array], options: dict[str, Any]) -> Array:
    """Make the values of an input: a batch of one image or of both."""
    found = []
    for eye in each.eyes:
        image = images[eye]
        size = each.height or image.shape[0], each.width or image.shape[1]
        if size != image.shape[:2]:
            shrinks = size[0] < image.shape[0]
            image = cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
        found.append(_normalise_image(image, each, options))
    tensor = np.concatenate(found, axis=-1)
    return np.ascontiguousarray(tensor if each.channels_last else tensor.transpose(2, 0, 1))[None].astype(each.dtype)


def _normalise_image(image: Array, each: _Input, options: dict[str, Any]) -> Array:
    """Normalise uint8 RGB (H, W, 3) as the options state, to float32 (H, W, channels)."""
    values = image.astype(np.float32)
    if options["numbers"] != "byte":
        values /= 255
    if options["numbers"] == "signed":
        values = 2 * values - 1
    elif options["numbers"] == "imagenet":
        values = (values - _IMAGENET_MEAN) / _IMAGENET_SPREAD
    if each.channels == 1:
        return values.mean(axis=-1, keepdims=True)
    return values[..., ::-1] if options["order"] == "bgr" else values


def _select_output_map(
    network: _Network, outputs: Sequence[Array], place: int, option: str, shape: tuple[int, int]
) -> Array:
    """Select the map (H, W) in the output that an option names: the first channel of the first image. Raises
    IcyMoonError if the output has no such map.
    """
    declared = network.session.get_outputs()
    found = np.asarray(outputs[place]) if place < len(outputs) else None
    if found is not None and found.ndim >= 2 and found.dtype.kind == "f":
        while found.ndim > 2 and (found.shape[-2:] == shape or found.shape[0] == 1):
            found = found[0]
        while found.ndim > 2:
            found = found[..., 0]
        if found.shape == shape:
            return found
    raise IcyMoonError(
        f"onnx.{option} is {place}, and the network's outputs are {_describe_declared(declared)}; choose the one "
        f"with the {'disparities' if option == 'output' else 'confidence'} of the whole image, "
        f"{shape[1]} x {shape[0]} px."
    )


def _test_network(network: _Network, options: dict[str, Any]) -> None:
    """Raise IcyMoonError unless the network recovers the shift of a texture."""
    found = _find_shifts(network, options)
    if _match_shifts(found):
        return
    listed, shifts = (" and ".join(f"{each:.4g}" for each in values) for values in (found, _SHIFTS_PX))
    raise IcyMoonError(
        f"onnx.model {_find_model_path(options).name} finds {listed} px where the images are shifted by {shifts} "
        f"px; {_advise_on_shifts(network, found, options)}."
    )


def _find_shifts(network: _Network, options: dict[str, Any]) -> tuple[float, ...]:
    """Find the median disparity, px, that a network estimates for each of ``_SHIFTS_PX``."""
    height, width = network.fixed or _TEST_SHAPE
    most = max(_SHIFTS_PX)
    # Squares of several sizes: as fine as a pixel, and as coarse as the features at a sixteenth of the size.
    random = np.random.default_rng(0)
    texture = np.zeros((height, width + most, 3), np.float32)
    for side, weight in ((1, 20.0), (2, 30.0), (4, 40.0), (8, 40.0), (16, 40.0)):
        squares = random.normal(0, weight, (-(-height // side), -(-(width + most) // side), 3))
        texture += np.kron(squares, np.ones((side, side, 1)))[:height, : width + most]
    image = np.clip(texture + 128, 0, 255).astype(np.uint8)
    found = []
    for shift in _SHIFTS_PX:
        # A point at column x of the left image is at x less the shift of the right one.
        disparity = _run_network(network, image[:, :width], image[:, shift : shift + width], options).disparity
        inner = disparity[height // 8 : height - height // 8, width // 8 : width - width // 8]
        found.append(float(np.median(inner)))
    return tuple(found)


def _match_shifts(found: Sequence[float], factor: float = 1.0) -> bool:
    return all(abs(factor * each - shift) <= _TOLERANCE_PX for each, shift in zip(found, _SHIFTS_PX, strict=True))


def _advise_on_shifts(network: _Network, found: Sequence[float], options: dict[str, Any]) -> str:
    """Write a clause with advice for a network that estimates wrong shifts."""
    if _match_shifts(found, -1.0):
        return f"give onnx.sign={'positive' if options['sign'] == 'negative' else 'negative'}"
    factors = [shift / each if each else np.inf for each, shift in zip(found, _SHIFTS_PX, strict=True)]
    if np.isfinite(factors).all() and abs(factors[0] / factors[1] - 1) <= _TOLERANCE_SHARE:
        factor = options["scale"] * abs(factors[1])
        sign = " and the other onnx.sign" if factors[1] < 0 else ""
        return (
            f"look at onnx.numbers, onnx.order and onnx.output, or give onnx.scale={factor:.3g}{sign} if the "
            "network has other units"
        )
    other = "yes" if options["swap"] == "no" else "no"
    if _match_shifts(_find_shifts(network, options | {"swap": other})):
        return f"its inputs seem to be exchanged: give onnx.swap={other}"
    return "look at onnx.numbers, onnx.order, onnx.output and onnx.swap"


def _describe_declared(declared: Sequence[Any]) -> str:
    return ", ".join(f"{each.name} {'x'.join(map(str, each.shape))}" for each in declared)


def find_most_s(timeout_s: float, pixels: int) -> float:
    """Find the seconds that an input of ``pixels`` pixels may take, if a small one may take ``timeout_s``."""
    return timeout_s * max(1.0, pixels / _TIMED_PIXELS)


def run_bounded(session: onnxruntime.InferenceSession, given: dict[str, Array], most_s: float) -> list[Array]:
    """Run a network, and return its outputs. It is stopped after ``most_s`` seconds, because it may have an infinite
    loop.

    Raises TimeoutError if it was stopped.
    """
    import onnxruntime

    how = onnxruntime.RunOptions()
    clock = threading.Timer(most_s, lambda: setattr(how, "terminate", True))
    clock.daemon = True
    clock.start()
    try:
        return list(session.run(None, given, how))
    except Exception:
        if how.terminate:
            raise TimeoutError from None
        raise
    finally:
        clock.cancel()


def find_first_line(error: Exception) -> str:
    """Return the first line of ONNX Runtime's message, without the prefix, number and name of the error."""
    line = (str(error).splitlines() or [type(error).__name__])[0]
    return re.sub(r"^\[ONNXRuntimeError\] : \d+ : [A-Z_]+ : ", "", line)[:300].rstrip(". ")
