"""Make pairs and images in the light of a projector, from one render with its lamp and the ray-traced shares of its
light.

Light is linear, so a pattern needs no render. A share of the direct light of the lamp reaches each pixel, see
``rays.projector``. Indirect light follows the mean of the pattern: it is spread like the indirect light of an even
projector.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..formats.exr_add import add_light
from ..formats.exr_parts import assemble, read_pieces
from ..physics.camera.blur import describe_blur_identity
from ..physics.light.lamps import list_lamp_groups
from ..physics.projector.decode import decode_columns, triangulate_columns
from ..physics.projector.device import Projector
from ..physics.projector.patterns import Pattern
from ..render.pairs.pair_folder import EYES, Pair, is_whole
from ..render.pairs.publish_pair import publish_pair
from ..settings.description import merged
from ..settings.pair_ids import make_pair_id
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.files import explain_disk_errors, hash_file, make_part_path, write_json
from ..support.foreign_bytes import ForeignBytes, parse_npz, read
from ..support.labels import IMAGE_PASS
from .export.cameras import make_pixel_rays
from .images.develop import develop
from .images.exr import Light
from .images.image_files import write_npz, write_png
from .images.views import read_eye

#: Least difference of white and black in a decoded image, as a share of full scale.
_MIN_CONTRAST = 0.04
_RENDER_AGAIN = "move the folder away and run icymoon projector again"
_INDIRECT_NOTE = (
    "projector: the light of the lamp that reaches a pixel over other ground is spread as by an even field."
)
_ICE_NOTE = "projector: light that enters ice and leaves it elsewhere does not blur the pattern."


@dataclass(frozen=True)
class Projection:
    """Patterns projected on a scene, from the file of ``render.projector_worker``.

    For each eye, ``share`` (count, H, W) is the part of the lamp's light that each pattern brings to a pixel, and
    ``place`` (H, W, 2) are the projector's coordinates that light the pixel; see ``rays.projector.ProjectedEye``.
    ``pose`` (4, 4) is the projector's pose in the world, and ``mean`` (count,) the mean of each pattern.
    """

    share: dict[str, Array]
    place: dict[str, Array]
    pose: Array
    mean: Array


def read_projection(path: Path) -> Projection:
    """Read the file of ``render.projector_worker``. Raises IcyMoonError if it is damaged."""
    fix = "run icymoon projector again"
    found = read(path, parse_npz, "a projection", fix, memory=2**33)
    try:
        return Projection(
            {eye: found[f"{eye}_share"] for eye in EYES},
            {eye: found[f"{eye}_place"] for eye in EYES},
            found["pose"],
            found["mean"],
        )
    except KeyError as error:
        raise IcyMoonError(f"{path} lacks {error}; {fix}.") from None


def find_refusal(settings: Settings) -> str:
    """Return a sentence on why patterns cannot be projected in a scene with these settings; "" if they can."""
    rig = settings.rig
    for bad, what, fix in (
        (rig.images != "PAIR", "has no pair", "set rig.images to PAIR"),
        (rig.eyes != "ALIKE", "has calibrated eyes", "set rig.eyes to ALIKE"),
        (rig.toe_in_deg != 0, "has toed-in eyes", "set rig.toe_in_deg to 0"),
        (rig.readout_s != 0, "has a rolling shutter", "set rig.readout_s to 0"),
        (bool(describe_blur_identity(settings)), "moves while it is exposed", "set rig.speed_… and rig.turn_… to 0"),
        (settings.quality.denoiser != "NONE", "is denoised without its light groups", "set quality.denoiser to NONE"),
        (settings.dataset.headings != 1, "has several headings", "set dataset.headings to 1"),
    ):
        if bad:
            return f"A pattern cannot be projected, because the camera {what}; {fix}."
    return ""


@dataclass(frozen=True)
class WhiteLight:
    """The light of a pair whose last lamp is a projector with all pixels on. By eye, (H, W, 3): the light of all other
    sources, and the projector's direct and indirect light.
    """

    others: dict[str, Array]
    direct: dict[str, Array]
    indirect: dict[str, Array]

    @classmethod
    def read(cls, white: Pair, direct: Pair | None) -> WhiteLight:
        """Read the light of the pair ``white``. ``direct`` is the same pair without bounces of light; None if ``white``
        has no bounces.
        """
        group = list_lamp_groups(white.settings.light)[-1]
        light = {eye: read_eye(white, eye)[0] for eye in EYES}
        once = light if direct is None else {eye: read_eye(direct, eye)[0] for eye in EYES}
        return cls(
            {eye: light[eye].radiance - light[eye].groups[group] for eye in EYES},
            {eye: once[eye].groups[group] for eye in EYES},
            {eye: light[eye].groups[group] - once[eye].groups[group] for eye in EYES},
        )

    def mix(self, eye: str, share: Array, mean: float) -> Array:
        """Return the projector's light (H, W, 3) with a pattern that brings ``share`` (H, W) to each pixel and has this
        mean.
        """
        return np.asarray(share[..., None] * self.direct[eye] + np.float32(mean) * self.indirect[eye])


def describe_projector(projector: Projector, pattern: Pattern, pose: Array) -> dict[str, Any]:
    """Make the entry ``projector`` of ``pair.json``."""
    return {"projector": vars(projector), "pattern": vars(pattern), "pose_to_world": pose.tolist()}


def save_projected_pair(
    white: Pair, light: WhiteLight, found: Projection, facts: Mapping[str, Any], dataset: Path
) -> Path:
    """Write a pair in the light of the first pattern to a data set, and return its folder. An existing pair is kept.

    The pair's id depends on the pattern: ``own_files_sha256`` contains the pattern's hash.
    """
    own = hashlib.sha256(
        (str(white.data.get("own_files_sha256", "")) + json.dumps(facts, sort_keys=True)).encode()
    ).hexdigest()
    name = make_pair_id(white.settings, own + describe_blur_identity(white.settings))
    folder = dataset / "pairs" / name
    if is_whole(folder):
        return folder
    part, files = make_part_path(folder), {}
    with explain_disk_errors("write", folder):
        part.mkdir(parents=True)
        for file in white.data["files"]:
            data = read(white.folder / file, ForeignBytes.content, "a file of a pair", _RENDER_AGAIN)
            if (eye := file.removesuffix(".exr")) in EYES:
                data = _replace_light(
                    data, white, light, eye, light.mix(eye, found.share[eye][0], float(found.mean[0]))
                )
            (part / file).write_bytes(data)
            files[file] = {"bytes": len(data), "sha256": hash_file(part / file)}
        left_out = [*white.data.get("left_out", []), _INDIRECT_NOTE, _ICE_NOTE]
        write_json(
            part / "pair.json",
            {
                **white.data,
                "id": name,
                "own_files_sha256": own,
                "projector": {**facts, "rendered_as": white.id},
                "left_out": left_out,
                "files": files,
            },
        )
    publish_pair(part, folder, lambda: False)
    return folder


def _replace_light(data: bytes, white: Pair, light: WhiteLight, eye: str, now: Array) -> bytes:
    """Return the bytes of an eye's image with the projector's light replaced by ``now`` (H, W, 3)."""
    group, change = list_lamp_groups(white.settings.light)[-1], now - light.direct[eye] - light.indirect[eye]
    bands = {band: change[..., k] for k, band in enumerate("RGB")}
    return assemble(add_light(read_pieces(data), {IMAGE_PASS: bands, f"{IMAGE_PASS}_{group}": bands}))


@dataclass(frozen=True)
class Decoded:
    """The columns of the projector (H, W) that an eye's images show, the true columns, the planar depth, m, from the
    decoded columns, and the true depth, m; NaN where unknown.
    """

    column: Array
    true_column: Array
    depth_m: Array
    true_depth_m: Array

    def summarise(self) -> dict[str, float]:
        """Return the share of the lit pixels with a decoded column, and the errors of columns and depths. Raises
        IcyMoonError if no column was decoded.
        """
        lit, known = np.isfinite(self.true_column), np.isfinite(self.column) & np.isfinite(self.true_column)
        if not known.any():
            raise IcyMoonError(
                "No pixel shows the code of the projector; raise --power, switch other light off, or aim it at ground "
                "that the cameras see."
            )
        off, far = (self.column - self.true_column)[known], (self.depth_m / self.true_depth_m - 1)[known]
        return {
            "decoded_share": float(known.sum() / lit.sum()),
            "column_median_px": float(np.median(np.abs(off))),
            "column_beyond_1_px_share": float((np.abs(off) > 1).mean()),
            "depth_median_share": float(np.nanmedian(np.abs(far))),
        }


def develop_patterns(
    white: Pair, light: WhiteLight, found: Projection, settings: Settings
) -> tuple[dict[str, list[Array]], int]:
    """Develop the images by eye in the light of each pattern, at the exposure of the projector with all pixels on; also
    return the bits of their numbers.
    """
    images: dict[str, list[Array]] = {eye: [] for eye in EYES}
    bits, fixed = 0, settings
    for k, mean in enumerate(found.mean.tolist()):
        lit = {
            eye: Light(np.maximum(light.others[eye] + light.mix(eye, found.share[eye][k], mean), 0.0), {})
            for eye in EYES
        }
        made = develop(replace(white, id=f"{white.id}-{k}"), lit["left"], lit["right"], fixed)
        # The first pattern has all pixels on.
        fixed = (
            merged(settings, {"sensor": {"auto_exposure": False, "exposure_s": made.exposure_s}}) if not k else fixed
        )
        bits = made.bits
        images["left"].append(made.left)
        images["right"].append(made.right)
    return images, bits


def decode_pair(
    white: Pair, images: Mapping[str, list[Array]], bits: int, found: Projection, projector: Projector, pattern: Pattern
) -> dict[str, Decoded]:
    """Decode the columns and depths of both eyes from their images of Gray code and phase."""
    decoded = {}
    for eye in EYES:
        pose, (_, view) = white.rectified_pose(eye), read_eye(white, eye)
        assert pose is not None
        column = decode_columns(np.stack(images[eye]), projector, pattern.period_px, _MIN_CONTRAST * (2.0**bits - 1))
        depth = triangulate_columns(column, projector, found.pose, pose, make_pixel_rays(white.camera))
        place = white.camera.cropped(found.place[eye][..., 0])
        decoded[eye] = Decoded(column, place, depth, view.depth)
    return decoded


def write_code(folder: Path, images: Mapping[str, list[Array]], decoded: Mapping[str, Decoded]) -> None:
    """Write the images as PNG and the decoded columns and depths as npz."""
    with explain_disk_errors("write to", folder):
        folder.mkdir(parents=True, exist_ok=True)
    for eye, frames in images.items():
        for k, image in enumerate(frames):
            write_png(folder / f"{eye}_{k:02d}.png", image)
    for eye, each in decoded.items():
        write_npz(folder / f"{eye}.npz", {key: value.astype(np.float32) for key, value in vars(each).items()})
