"""Make the small pictures of shipped presets that the sidebar and the Asset Browser show: presets/previews/NAME.jpg.

    python docs/make/previews.py [KIND/NAME ...]      all by default; takes some minutes
    python docs/make/previews.py choose               choose.jpg from the pictures that are there

Each is what the left camera gives of the scene preset, exposed by its own response. A preset of a part is shown in a
scene that is the same for its kind, in previews/KIND/NAME.jpg. choose.jpg, which is shown while no scene is chosen, is
four of them.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from icymoon.commands.render_scenes import render_settings
from icymoon.render.workers.job_commands import python_command
from icymoon.settings import description, preset_files
from icymoon.settings.topics.declaration import Parts
from icymoon.settings.topics.scene import Settings
from icymoon.stereo.images.develop import Channels
from icymoon.support.arrays import Array

#: Pixels of a preview in the usual proportion, and light paths per pixel, denoised. The sidebar shows it at a third.
WIDTH, HEIGHT, SAMPLES = 256, 192, 32
JPEG_QUALITY = 82
_SENSOR = {"auto_exposure": False}
_LOW_SUN: Parts = {"light": {"sun_elevation_deg": 25.0}}
_LIGHT: Parts = {**_LOW_SUN, "sensor": _SENSOR | {"exposure_s": 2.4e-5}}
#: The scene that shows presets of a part, with changes.
SAMPLES_OF: dict[str, tuple[str, Parts]] = {
    "surfaces": ("gallery/block_field", {**_LOW_SUN, "sensor": _SENSOR | {"exposure_s": 6.0e-5}}),
    "rigs": ("gallery/block_field", _LOW_SUN),
    "lights": ("gallery/block_field", _LIGHT),
    "bodies": ("gallery/block_field", _LIGHT),
}
#: Scenes that choose.jpg shows: no two alike, and each clear where the sidebar shows it small.
CHOICE = ("gallery/saturn_light", "gallery/penitentes", "scenes/europa_stained_plain", "scenes/workspace_europa_lander")
#: Kinds whose pictures all have one exposure, which shows their albedos or their light. The square root of the light is
#: shown, as rovers send it, so that the dark ones are not black.
SAME_EXPOSURE = ("surfaces", "lights", "bodies")
#: A view of a planet: degrees below the horizon and above the planet that are in it, and the Sun's direction from it.
_BELOW_DEG, _ABOVE_DEG, _SUN_TO_THE_RIGHT_DEG = 22.0, 3.0, 75.0


def look_at_planet(settings: Settings) -> Parts:
    """Make the settings that rotate the camera so that the planet is in the picture above the ground."""
    light, rig = settings.light, settings.rig
    top = light.planet_elevation_deg + light.planet_angular_diameter_deg / 2 + _ABOVE_DEG
    height_mm = rig.sensor_width_mm * HEIGHT / WIDTH
    return {
        "rig": {
            "heading_deg": light.planet_azimuth_deg,
            "pitch_deg": (_BELOW_DEG - top) / 2,
            "focal_length_mm": height_mm / 2 / math.tan(math.radians((top + _BELOW_DEG) / 2)),
        },
        "light": {"sun_azimuth_deg": light.planet_azimuth_deg + _SUN_TO_THE_RIGHT_DEG},
    }


def see_colour(settings: Settings) -> Parts:
    """A colour camera with an exposure that gives white ground as many electrons as the monochrome one of the
    settings."""
    rates = [Channels(settings.light, settings.sensor | {"colour": colour}, 1e-5).rate for colour in ("MONO", "BAYER")]
    return {
        "sensor": {
            "colour": "BAYER",
            "exposure_s": settings.sensor.exposure_s * rates[0] / rates[1],
            "psf_sigma_px": 0.6,
        }
    }  # without, rocks of few pixels would have coloured edges


def make(name: str, folder: Path) -> Path:
    """Render a preset such as scenes/europa_chaos into a folder and write its preview; returns the preview."""
    kind = name.split("/")[0]
    base, changes = SAMPLES_OF.get(kind, (name, {}))
    described = description.merged(
        description.defaults(),
        preset_files.load_preset(base),
        preset_files.load_preset(name),
        changes,
        {"quality": {"samples": SAMPLES, "denoiser": "OIDN"}},
    )
    if kind == "bodies":
        described = description.merged(described, look_at_planet(described))
    if kind == "surfaces":
        described = description.merged(described, see_colour(described))
    rig = described.rig
    described["rig"] = rig | {"width_px": HEIGHT * rig.width_px // rig.height_px, "height_px": HEIGHT}
    render_settings(described, folder / name, sys.executable)
    (pair,) = (folder / name).glob("pairs/*/")
    shown = folder / "shown" / name
    subprocess.run(
        python_command(sys.executable, "stereo", "develop", str(pair), "--out", str(shown)),
        check=True,
        stdout=subprocess.DEVNULL,
    )
    image = cv2.imread(str(next(shown.rglob("left.png"))), cv2.IMREAD_UNCHANGED)
    light = image / (2.0 ** json.loads(next(shown.rglob("images.json")).read_text())["image_bits"] - 1)
    image = np.rint(255 * (np.sqrt(light) if kind in SAME_EXPOSURE else light)).astype(np.uint8)
    target = preset_files.find_preview(name)
    _write(target, image)
    return target


def _write(target: Path, image: Array) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(target), image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])


def make_choice() -> None:
    """Write the picture of four scenes, as large as one of them."""
    images = [cv2.imread(str(preset_files.find_preview(name))) for name in CHOICE]
    small = [cv2.resize(image, (WIDTH // 2, HEIGHT // 2), interpolation=cv2.INTER_AREA) for image in images]
    _write(preset_files.find_preview("choose"), np.vstack([np.hstack(small[:2]), np.hstack(small[2:])]))


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="icymoon-previews-") as made:
        kinds = ("scenes", "gallery", *SAMPLES_OF)
        for wanted in sys.argv[1:] or [name for kind in kinds for name in preset_files.preset_names(kind)]:
            if wanted != "choose":
                print(make(wanted, Path(made)), flush=True)
    make_choice()
