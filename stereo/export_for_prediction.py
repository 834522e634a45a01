"""Write the input of a method on another machine: the images of each pair and their camera, without the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..support.errors import DiskError, describe_error
from ..support.files import write_text
from .evaluate import Event
from .evaluated_pairs import check_response, find_sources
from .export.layouts import make_middlebury_text
from .images.image_files import write_png

_README = """\
A folder for each pair: im0.png is the left image, im1.png the right one, calib.txt their camera as Middlebury has it.

Write the disparities of the left image to one folder, one file for each pair, in px, named after the pair:
{example}.npy, .pfm, .exr, or 16-bit .png with 256 steps per px. A pixel without a disparity is 0, NaN or infinite.

Then evaluate them:
python -m icymoon.stereo evaluate DATASET --predictions NAME=FOLDER --out REPORT
"""


def export_for_prediction(
    paths: Sequence[Path], out: Path, response: Mapping[str, Mapping[str, Any]], on_event: Event = lambda event: None
) -> list[str]:
    """Write ``<out>/<pair>/im0.png``, ``im1.png`` and ``calib.txt`` of all pairs at ``paths``, and ``README.txt``.

    Matchers get the same images here. Return a sentence for each pair that failed; each sentence is also an event
    {"type": "error", "message"}. Raises IcyMoonError if there is no pair or ``out`` cannot be written.
    """
    sources = find_sources(paths)
    check_response(sources, response)
    failed = []
    for done, source in enumerate(sources, 1):
        try:
            prepared = source.prepare(response)
            folder = out / source.name
            for name, image in (("im0.png", prepared.left), ("im1.png", prepared.right)):
                write_png(folder / name, image)
            write_text(folder / "calib.txt", make_middlebury_text(prepared.depth_camera.rectified))
        except DiskError:
            raise
        except Exception as error:
            failed.append(describe_error(error, source.folder))
            on_event({"type": "error", "message": failed[-1]})
            continue
        on_event(
            {
                "type": "progress",
                "fraction": done / len(sources),
                "done": done,
                "total": len(sources),
                "message": source.name,
            }
        )
    write_text(out / "README.txt", _README.format(example=sources[0].name))
    return failed
