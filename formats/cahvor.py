"""The camera models CAHV, CAHVOR and CAHVORE, in which cameras of Mars rovers and landers are calibrated.

C is the centre, A the axis, H and V are the horizontal and vertical vectors, O is the optical axis of the distortion, R
has its radial coefficients, E the coefficients of the entrance pupil. Yakimovsky and Cunningham 1978 (Computer Graphics
and Image Processing 7, 195), Gennery 2006 (International Journal of Computer Vision 68, 239), Di and Li 2004 (JGR
Planets 109, E04004). Distances are in metres. The centre of the first pixel is (0, 0); columns go right, rows down.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..physics.camera.cahvore import bend
from ..physics.camera.lens_distortion import distort_points
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.file_schemas import PIXELS
from ..support.files import shorten
from ..support.foreign_bytes import ForeignBytes, RefusedError, read
from ..support.number_text import format_count
from .odl import Group, Value, parse_label

_VECTOR_LETTERS = "CAHVORE"
_VECTOR_NAMES = {
    "C": "CENTER",
    "A": "AXIS",
    "H": "HORIZONTAL",
    "V": "VERTICAL",
    "O": "OPTICAL",
    "R": "RADIAL",
    "E": "ENTRANCE",
}
_VECTOR_UNITS = {"C": "METER", "H": "PIXEL", "V": "PIXEL"}
#: Largest cosine of the angle between H and V of a camera with square, upright pixels.
_MAX_SKEW = 1e-6
#: Largest difference, px, of a fitted model from the lens, unless the user allows more.
FIT_LIMIT_PX = 0.05
_MAX_FIT_STEPS = 60


@dataclass(frozen=True)
class Cahvor:
    """A camera by its vectors (3,) in world axes. ``o`` and ``r`` are None for CAHV; ``e`` is None except for CAHVORE.
    ``linearity`` is 1 for a perspective lens and 0 for a fisheye. ``residual_px`` is the largest error if the model was
    fitted to another lens, and 0 if it is exact."""

    c: Array
    a: Array
    h: Array
    v: Array
    width_px: int
    height_px: int
    o: Array | None = None
    r: Array | None = None
    e: Array | None = None
    linearity: float = 1.0
    residual_px: float = 0.0

    @property
    def kind(self) -> str:
        """Name of the model: CAHV, CAHVOR or CAHVORE."""
        return "CAHV" if self.o is None else "CAHVOR" if self.e is None else "CAHVORE"

    def project(self, points_m: Array) -> Array:
        """Project points (..., 3), m, in world axes to columns and rows (..., 2); NaN for points behind the camera of a
        CAHV or CAHVOR."""
        d = np.asarray(points_m, np.float64) - self.c
        if self.o is not None and self.r is not None:
            d = bend(d, self.o, self.r, self.e, self.linearity)
        ahead = d @ self.a
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.stack([d @ self.h / ahead, d @ self.v / ahead], axis=-1)
        return np.where((ahead > 0)[..., None], found, np.nan)

    def pinhole(self) -> tuple[Array, Array]:
        """Return K (3, 3), and the rotation (3, 3) from world axes to the camera's axes: x right, y down, z forward.

        Raises IcyMoonError if the pixels are not rectangles.
        """
        hc, vc = float(self.h @ self.a), float(self.v @ self.a)
        right, down = self.h - hc * self.a, self.v - vc * self.a
        fx, fy = float(np.linalg.norm(right)), float(np.linalg.norm(down))
        if not (fx > 0 and fy > 0 and abs(np.linalg.norm(self.a) - 1) < 1e-6):
            raise IcyMoonError("The camera model has no unit axis A, or H or V along it; check its file.")
        if abs(right @ down) > _MAX_SKEW * fx * fy:
            raise IcyMoonError(
                "The pixels of the camera model are skewed, which Icy Moon's cameras do not support; rectify "
                "its images first."
            )
        return np.array([[fx, 0, hc], [0, fy, vc], [0, 0, 1.0]]), np.stack([right / fx, down / fy, self.a])


def make_model_from_pinhole(
    matrix: Array,
    rotation: Array,
    centre_m: Array,
    size_px: tuple[int, int],
    k: Sequence[float] = (),
    most_px: float = FIT_LIMIT_PX,
) -> Cahvor:
    """Make the model of a camera with matrix K (3, 3), ``rotation`` (3, 3) from world axes to the camera's, and
    distortion ``k``, OpenCV's k1, k2, p1, p2, k3.

    k1 and k2 are exact in CAHVOR, with O along A. For other coefficients the model is fitted to the lens over the
    image. Raises IcyMoonError if the fit is off by more than ``most_px``.
    """
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    right, down, a = rotation
    plain = Cahvor(centre_m, a, fx * right + cx * a, fy * down + cy * a, *size_px)
    if not any(k):
        return plain
    k1, k2, p1, p2, k3 = k
    if not (p1 or p2 or k3):
        return Cahvor(plain.c, plain.a, plain.h, plain.v, *size_px, a, np.array([0.0, k1, k2]))
    return _fit_cahvor(matrix, rotation, centre_m, size_px, (k1, k2, p1, p2, k3), most_px)


def _sample_pixels(width: int, height: int) -> Array:
    """Return the columns and rows (n, 2) of pixels spread over an image."""
    return np.stack(np.meshgrid(np.linspace(0, width - 1, 33), np.linspace(0, height - 1, 25)), axis=-1).reshape(-1, 2)


def _make_cahvor(p: Array, rotation: Array, centre_m: Array, size_px: tuple[int, int]) -> Cahvor:
    """Make a CAHVOR from the parameters ``p``: fx, fy, cx, cy, the two angles between O and A, and the three of R."""
    right, down, a = rotation
    o = np.array([np.sin(p[4]) * np.cos(p[5]), np.sin(p[5]), np.cos(p[4]) * np.cos(p[5])]) @ rotation
    return Cahvor(centre_m, a, p[0] * right + p[2] * a, p[1] * down + p[3] * a, *size_px, o, p[6:9])


def _fit_cahvor(
    matrix: Array,
    rotation: Array,
    centre_m: Array,
    size_px: tuple[int, int],
    k: tuple[float, ...],
    most_px: float,
) -> Cahvor:
    """Fit a CAHVOR by least squares over the image (Levenberg and Marquardt). Raises IcyMoonError if it is off by more
    than ``most_px``."""
    width, height = size_px
    pixels = _sample_pixels(width, height)
    focal, principal = matrix[[0, 1], [0, 1]], matrix[:2, 2]
    rays = (pixels - principal) / focal
    target = distort_points(rays, k) * focal + principal
    points = np.concatenate([rays, np.ones((len(rays), 1))], axis=1) @ rotation + centre_m

    def residuals(p: Array) -> Array:
        return (_make_cahvor(p, rotation, centre_m, size_px).project(points) - target).ravel()

    p = np.array([*focal, *principal, 0.0, 0.0, 0.0, k[0], k[1]])
    scale = np.array([*focal, width, height, 0.1, 0.1, 0.1, 0.1, 0.1])
    damping, found = 1e-3, residuals(p)
    for _ in range(_MAX_FIT_STEPS):
        slope = np.stack([(residuals(p + step) - found) / 1e-6 for step in np.diag(1e-6 * scale)], axis=1)
        change = np.linalg.solve(slope.T @ slope + damping * np.diag((slope**2).sum(axis=0) + 1e-12), -slope.T @ found)
        tried = residuals(p + change * scale)
        if tried @ tried < found @ found:
            p, found, damping = p + change * scale, tried, damping / 5
        else:
            damping *= 5
        if np.abs(change).max() < 1e-10 or damping > 1e12:
            break
    residual = float(np.abs(found).max())
    if not residual <= most_px:
        raise IcyMoonError(
            f"rig.distortion_p1, p2 and k3 cannot be represented in CAHVOR: the nearest model is off by up to "
            f"{residual:.2g} px, more than {most_px:g} px; export raw, or lower them."
        )
    return replace(_make_cahvor(p, rotation, centre_m, size_px), residual_px=residual)


@dataclass(frozen=True)
class Lens:
    """A camera with square pixels and OpenCV's distortion ``k``: k1, k2, p1, p2, k3. ``residual_px`` is the largest
    difference over the image from the model to which it was fitted, and 0 if it is exact."""

    focal_px: float
    cx_px: float
    cy_px: float
    k: tuple[float, ...]
    residual_px: float


def find_nearest_lens(model: Cahvor, most_px: float = FIT_LIMIT_PX) -> Lens:
    """Find the Icy Moon lens that is nearest to a model, with the model's centre and rotation.

    With square pixels, CAHV is exact, and so is CAHVOR if O lies along A and its first coefficient is 0. Raises
    IcyMoonError if the nearest lens is off by more than ``most_px``.
    """
    matrix, rotation = model.pinhole()
    focal, principal = matrix[[0, 1], [0, 1]], matrix[:2, 2]
    radial = model.e is None and (
        model.o is None or model.r is None or (model.r[0] == 0.0 and np.allclose(model.o, model.a, rtol=0, atol=1e-12))
    )
    if radial and abs(focal[0] - focal[1]) < 1e-9 * focal[0]:
        k1, k2 = (0.0, 0.0) if model.r is None else model.r[1:]
        cx, cy = map(float, principal)
        return Lens(float(focal[0]), cx, cy, (float(k1), float(k2), 0.0, 0.0, 0.0), 0.0)
    # Columns and rows are linear in f, cx, cy and f times each coefficient.
    x, y = ((_sample_pixels(model.width_px, model.height_px) - principal) / focal).T
    seen = model.project(np.stack([x, y, np.ones_like(x)], axis=1) @ rotation + model.c)
    r2, one, none = x**2 + y**2, np.ones_like(x), np.zeros_like(x)
    if not np.isfinite(seen).all():
        raise IcyMoonError("Some pixels of the camera model are outside the field of its lens; check its file.")
    columns = [
        (x, y),
        (one, none),
        (none, one),
        (x * r2, y * r2),
        (x * r2**2, y * r2**2),
        (2 * x * y, r2 + 2 * y**2),
        (r2 + 2 * x**2, 2 * x * y),
        (x * r2**3, y * r2**3),
    ]
    design = np.stack([np.concatenate(each) for each in columns], axis=1)
    wanted = seen.T.ravel()
    found, *_ = np.linalg.lstsq(design, wanted, rcond=None)
    residual = float(np.abs(design @ found - wanted).max())
    if not residual <= most_px:
        raise IcyMoonError(
            "The lens of the camera model cannot be represented by k1, k2, p1, p2, k3: the nearest is off by up "
            f"to {residual:.2g} px, more than {most_px:g} px; rectify its images first."
        )
    f, cx, cy, *k = found.tolist()
    return Lens(f, cx, cy, tuple(each / f for each in k), residual)


def make_cahvor_text(model: Cahvor) -> str:
    """Write a model as the text of a ``.cahvor`` file of JPL and mrcal, with all digits."""
    matrix, _ = model.pinhole()
    words = {
        "CAHV": "CAHV = perspective, linear",
        "CAHVOR": "CAHVOR = perspective, distortion",
        "CAHVORE": f"CAHVORE3,{model.linearity:.17g} = general",
    }[model.kind]
    lines = [f"Dimensions = {model.width_px} {model.height_px}", f"Model = {words}"]
    if model.residual_px:
        lines.insert(0, f"# fitted to a lens that is not CAHVOR, error up to {model.residual_px:.2g} px")
    lines += [f"{letter} = {' '.join(f'{value:.17g}' for value in vector)}" for letter, vector in _list_vectors(model)]
    lines += [
        f"{name} = {value:.17g}"
        for name, value in (("Hs", matrix[0, 0]), ("Hc", matrix[0, 2]), ("Vs", matrix[1, 1]), ("Vc", matrix[1, 2]))
    ]
    return "\n".join([*lines, "Theta = -1.5707963267948966 (-90.0 deg)", ""])


def make_pds_text(model: Cahvor, frame: str) -> str:
    """Write a model as a group of a PDS3 label; ``frame`` names the coordinate system of the vectors."""
    vectors = _list_vectors(model)
    letters = [letter for letter, _ in vectors]

    def quoted(words: Sequence[str]) -> str:
        return "(" + ", ".join(f'"{word}"' for word in words) + ")"

    # The letters T and P are the type of CAHVORE, 3 for general, and its linearity.
    more = ["T", "P"] if model.kind == "CAHVORE" else []
    names = [*(_VECTOR_NAMES[x] for x in letters), *(["TYPE", "PARAMETER"] if more else [])]
    lines = [
        "GROUP = GEOMETRIC_CAMERA_MODEL",
        f'  MODEL_TYPE = "{model.kind}"',
        f"  MODEL_COMPONENT_ID = {quoted([*letters, *more])}",
        f"  MODEL_COMPONENT_NAME = {quoted(names)}",
        f"  MODEL_COMPONENT_UNIT = {quoted([*(_VECTOR_UNITS.get(x, 'N/A') for x in letters), *(['N/A'] * len(more))])}",
    ]
    lines += [
        f"  MODEL_COMPONENT_{k} = ({', '.join(f'{value:.17g}' for value in vector)})"
        for k, (_, vector) in enumerate(vectors, 1)
    ]
    if more:
        lines += [
            f"  MODEL_COMPONENT_{len(vectors) + 1} = 3",
            f"  MODEL_COMPONENT_{len(vectors) + 2} = {model.linearity:.17g}",
        ]
    lines += [
        f'  REFERENCE_COORD_SYSTEM_NAME = "{frame}"',
        "  REFERENCE_COORD_SYSTEM_INDEX = 0",
        "END_GROUP = GEOMETRIC_CAMERA_MODEL",
        "GROUP = IMAGE_DATA",
        f"  LINES = {model.height_px}",
        f"  LINE_SAMPLES = {model.width_px}",
        "END_GROUP = IMAGE_DATA",
        "END",
        "",
    ]
    return "\r\n".join(lines)


def _list_vectors(model: Cahvor) -> list[tuple[str, Array]]:
    found = zip(_VECTOR_LETTERS, (model.c, model.a, model.h, model.v, model.o, model.r, model.e), strict=True)
    return [(letter, vector) for letter, vector in found if vector is not None]


#: Longest text of a number in a model.
_LONGEST_NUMBER = 60
#: Largest number in a model: the centre, in metres of a map's grid.
_LARGEST_NUMBER = 1e9
_NUMBER_PATTERN = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)
#: Bytes of a file that are searched for the model: a label may be the head of an image file.
_LABEL_BYTES = 2**20
_FIX = "give a .cahvor file or a PDS3 label"
#: Groups of a label that state the size of other images.
_NOT_THE_IMAGE = ("THUMBNAIL", "BROWSE", "REQUEST", "SUBFRAME")


def read_model(path: Path) -> Cahvor:
    """Read a camera model from a ``.cahvor`` file, or from a PDS3 label with the group GEOMETRIC_CAMERA_MODEL.

    The size in pixels is stated by the label's object IMAGE, or by its only image. Raises IcyMoonError if the file has
    no camera model, or an incomplete one.
    """
    return read(path, _parse_model, "a camera model", _FIX)


def _parse_model(foreign: ForeignBytes) -> Cahvor:
    text = foreign.part(0, min(foreign.size, _LABEL_BYTES)).decode("utf-8", "replace")
    vectors, linearity, size = _read_pds(text) if "GEOMETRIC_CAMERA_MODEL" in text else _read_cahvor(text)
    missing = [letter for letter in "CAHV" if letter not in vectors]
    if missing or ("O" in vectors) != ("R" in vectors) or ("E" in vectors and "O" not in vectors) or size is None:
        what = f"the vector {missing[0]}" if missing else "the size of the image" if size is None else "O or R"
        raise RefusedError(f"is not a supported camera model: {what} is missing; {_FIX}.")
    return Cahvor(
        vectors["C"],
        vectors["A"],
        vectors["H"],
        vectors["V"],
        *size,
        vectors.get("O"),
        vectors.get("R"),
        vectors.get("E"),
        linearity,
    )


#: Content of a text: the vectors, the linearity of CAHVORE, and the size of the image, if stated.
_StatedModel = tuple[dict[str, Array], float, tuple[int, int] | None]


def _parse_number(word: object, what: str) -> float:
    if (
        not isinstance(word, str)
        or len(word) > _LONGEST_NUMBER
        or not _NUMBER_PATTERN.fullmatch(word)
        or abs(float(word)) > _LARGEST_NUMBER
    ):
        raise ValueError(f"{what} is {shorten(str(word))!r}, not a number up to {_LARGEST_NUMBER:g}")
    return float(word)


def _parse_vector(words: Sequence[object], what: str) -> Array:
    if len(words) != 3:
        raise ValueError(f"{what} has {format_count(len(words), 'number')}, not 3")
    return np.array([_parse_number(word, what) for word in words])


def _parse_size(words: Sequence[object], what: str) -> tuple[int, int]:
    """Parse the size of an image; return columns and rows."""
    found = [
        word
        for word in words
        if isinstance(word, str)
        and word.isdecimal()
        and word.isascii()
        and len(word) <= _LONGEST_NUMBER
        and PIXELS.fits(int(word))
    ]
    if len(found) != 2 or len(words) != 2:
        raise ValueError(f"{what} is {shorten(' x '.join(map(str, words)))!r}, not {PIXELS.name} twice")
    return int(found[0]), int(found[1])


def _read_cahvor(text: str) -> _StatedModel:
    stated: dict[str, tuple[int, list[str]]] = {}  # by key: the line, and the words after the first equals sign
    key = ""
    for number, line in enumerate(text.splitlines(), 1):
        content = line.partition("#")[0]
        head, equals, rest = content.partition("=")
        if equals:
            key = head.strip()
            if key in stated and key in (*_VECTOR_LETTERS, "Dimensions", "Model"):
                raise ValueError(f"line {number} states {key} again")
            stated[key] = number, rest.split()
        elif key in (*_VECTOR_LETTERS, "Dimensions"):  # it goes on
            stated[key][1].extend(content.split())
    vectors = {
        letter: _parse_vector(stated[letter][1], f"line {stated[letter][0]}: {letter}")
        for letter in _VECTOR_LETTERS
        if letter in stated
    }
    size = None
    if "Dimensions" in stated:
        number, words = stated["Dimensions"]
        size = _parse_size(words[:2], f"line {number}: Dimensions")
    return vectors, _read_linearity(" ".join(stated["Model"][1])) if "Model" in stated else 1.0, size


def _read_linearity(model: str) -> float:
    """Read the linearity of a model such as ``CAHVORE3,0.4 = general``: 1 for type 1 (perspective), 0 for type 2
    (fisheye), and the stated number for type 3."""
    kind, _, parameter = model.partition("=")[0].strip().partition(",")
    if not kind.startswith("CAHVORE"):
        return 1.0
    of_type = {"1": 1.0, "2": 0.0}.get(kind.removeprefix("CAHVORE").strip())
    if of_type is not None:
        return of_type
    found = _NUMBER_PATTERN.match(parameter.strip()[:_LONGEST_NUMBER])
    return _parse_number(found[0], "the linearity") if found else 1.0


def _read_pds(text: str) -> _StatedModel:
    groups = parse_label(text).list_all_groups()
    models = [group for group in groups if "MODEL_COMPONENT_ID" in group.values]
    if not models:
        return {}, 1.0, _find_image_size(groups)
    model = next((group for group in models if group.name.startswith("GEOMETRIC_CAMERA_MODEL")), models[0])
    letters = _list_items(model, "MODEL_COMPONENT_ID")
    vectors: dict[str, Array] = {}
    linearity = 1.0
    for k, letter in enumerate(letters, 1):
        key = f"MODEL_COMPONENT_{k}"
        if key not in model.values or letter in vectors:
            continue
        if letter == "P":
            linearity = _parse_number(_list_items(model, key)[0], key) if _list_items(model, key) else 1.0
        elif isinstance(letter, str) and letter in [*_VECTOR_LETTERS]:
            vectors[letter] = _parse_vector(_list_items(model, key), key)
    return vectors, linearity, _find_image_size(groups)


def _list_items(group: Group, key: str) -> list[Value]:
    """Return the values of a keyword as a list, also if there is only one."""
    if key in group.unclear:
        raise ValueError(f"{key} is stated twice with different values")
    value = group.values[key]
    return value if isinstance(value, list) else [value]


def _find_image_size(groups: Sequence[Group]) -> tuple[int, int] | None:
    """Find the columns and rows of the object IMAGE, or else of the label's only image; None without an image."""
    keys = ("LINE_SAMPLES", "LINES")
    sized = [group for group in groups if all(key in group.values for key in keys)]
    images = [group for group in sized if group.name == "IMAGE"] or [
        group for group in sized if not any(word in group.name for word in _NOT_THE_IMAGE)
    ]
    found = list(
        dict.fromkeys(
            _parse_size(
                [item for key in keys for item in _list_items(group, key)],
                f"LINE_SAMPLES x LINES of {shorten(group.name) or 'the label'}",
            )
            for group in images
        )
    )
    if len(found) > 1:
        raise ValueError(
            f"it has images of {len(found)} sizes, {found[0]} and {found[1]}, and no size is marked as its own"
        )
    return found[0] if found else None
