"""Develop rendered pairs again with another camera response, without a new render."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..physics.camera.eyes import eyes_json
from ..physics.camera.lens_distortion import COEFFICIENTS, read_coefficients
from ..physics.light.lamps import is_light_scaled
from ..render.pairs.pair_folder import EYES, find_pair_folders, read_unchanged_pair
from ..settings.description import merged
from ..support.arrays import Array
from ..support.errors import IcyMoonError, describe_error
from ..support.files import write_json
from ..support.number_text import format_count
from ..support.system import remove
from .evaluate import Event
from .images.develop import DevelopedImages, describe_exposure, develop
from .images.exr import read_light
from .images.image_files import write_npy, write_png
from .images.lens import make_rectification
from .images.views import read_sensor_depth

#: Files that only some settings produce, so those from an earlier run are removed.
_REMOVED_FILES = re.compile(r"(left|right)_(\d+\.png|distorted\.png|mosaic\.png|deposits\.png|distorted_depth\.npy)")
FORMAT, VERSION = "icymoon-images", 1


def reexpose(
    paths: Sequence[Path], out: Path, response: Mapping[str, Mapping[str, Any]], on_event: Event = lambda event: None
) -> list[Path]:
    """Develop pairs, and all pairs of data sets, with another ``response``; return the folders of the images.

    Writes to ``out/<pair>/``:

    * ``left.png`` and ``right.png``, rectified, 8-bit, or 16-bit with ``image_bits`` bits, in colour if the sensor is;
    * with a colour sensor, its numbers as ``left_mosaic.png``, not rectified;
    * with brackets, every exposure as ``left_0.png`` and so on, the longest first, not rectified;
    * with a distorting lens, toed-in or calibrated eyes or an erroneous calibration, the image of the sensor as
      ``left_distorted.png`` (a colour sensor's is the mosaic), and the depth of its pixels (npy, metres along the axis
      of the eye, NaN for none);
    * with deposits on the lenses, the light that they block as ``left_deposits.png``, 255 where they block all of it;
    * last, ``images.json``: exposure, gain, calibration and settings.

    ``on_event`` gets the events of ``evaluate``. A pair that fails does not stop the others. Raises IcyMoonError if
    there is no pair and, at the end, if a pair failed.
    """
    folders = list(dict.fromkeys(folder for path in paths for folder in find_pair_folders(path)))
    done: list[Path] = []
    warned: set[str] = set()
    failed: list[str] = []
    for k, folder in enumerate(folders):
        try:
            images = _reexpose_pair(folder, out / folder.name, response)
            done.append(out / folder.name)
            for message in images.warnings:
                if message not in warned:
                    warned.add(message)
                    on_event({"type": "warning", "message": message})
        except Exception as error:
            failed.append(describe_error(error, folder))
            on_event({"type": "error", "message": failed[-1]})
        on_event(
            {
                "type": "progress",
                "fraction": (k + 1) / len(folders),
                "done": k + 1,
                "total": len(folders),
                "message": folder.name,
            }
        )
    if failed:
        raise IcyMoonError(f"{len(failed)} of {format_count(len(folders), 'pair')} failed, the first one: {failed[0]}")
    return done


def _reexpose_pair(folder: Path, out: Path, response: Mapping[str, Mapping[str, Any]]) -> DevelopedImages:
    pair = read_unchanged_pair(folder)
    settings = merged(pair.settings, response)
    scaled = is_light_scaled(settings)
    left, right = (read_light(pair.image(eye), eye, groups=scaled) for eye in EYES)
    images = develop(pair, left, right, settings)
    for stale in [path for path in out.glob("*") if _REMOVED_FILES.fullmatch(path.name)]:
        remove(stale)
    for name, numbers in _list_images(images, int(settings.sensor.bits)).items():
        write_png(out / f"{name}.png", numbers)
    maps = [make_rectification(pair.camera, settings.rig, settings.calibration_error, eye) for eye in EYES]
    for eye in EYES if any(each is not None for each in maps) else ():
        write_npy(out / f"{eye}_distorted_depth.npy", read_sensor_depth(pair, eye, settings.rig))
    write_json(
        out / "images.json",
        {
            "format": FORMAT,
            "version": VERSION,
            "pair": pair.id,
            "camera": pair.camera.to_json(),
            "eyes": eyes_json(pair.camera, settings.rig),
            "distortion": dict(zip(COEFFICIENTS, read_coefficients(settings.rig), strict=True)),
            **describe_exposure(images),
            "settings": {topic: settings[topic] for topic in ("sensor", "light", "calibration_error")},
        },
    )
    return images


def _list_images(images: DevelopedImages, sensor_bits: int) -> dict[str, Array]:
    """Return the images to write, by name. Images of 8 bits are uint8; colour images have the order B, G, R."""
    named = {eye: (images.for_files(eye), images.bits) for eye in EYES}
    if images.is_rectified:
        kind = "mosaic" if images.is_mosaic else "distorted"
        named |= {f"{eye}_{kind}": (getattr(images, f"detected_{eye}"), images.bits) for eye in EYES}
    named |= {f"{eye}_deposits": (share, 8) for eye, share in images.blocked.items()}
    if len(images.frames) > 1:
        named |= {
            f"{eye}_{k}": (getattr(frame, eye), sensor_bits) for k, frame in enumerate(images.frames) for eye in EYES
        }
    return {name: numbers.astype(np.uint8) if bits == 8 else numbers for name, (numbers, bits) in named.items()}
