"""The cost and error of each quality preset, for the ``[measured]`` tables of the presets.

    python benchmarks/qualities.py [--scale 0.25] [--reference-samples N] [--out FOLDER] [--write]

Each preset renders the same scene twice. Errors are relative to a render of many samples without a denoiser, see
``icymoon trade``. ``--write`` writes them to ``presets/qualities``.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

from icymoon.render.cost.variants import reference
from icymoon.render.workers.job import Job, render_job
from icymoon.settings import description, preset_files
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.trade.losses import measure, read_reference
from icymoon.stereo.trade.measure_variants import scaled_view
from icymoon.typed_settings import Settings

SCENE = "scenes/europa_rough_ice"
METHODS = "sgbm,bm,jplv"


def renders(settings: Settings, folder: Path, repeats: int = 2) -> list[Path]:
    """Pair folders of so many renders, each by a process of its own."""
    return [render_job(Job(folder, settings, repeat=k), sys.executable, lambda message: None)[0]
            for k in range(repeats)]


def written(path: Path, table: dict[str, Any]) -> None:
    """Put a table in the place of a preset's ``[measured]``."""
    text = path.read_text(encoding="utf-8").split("\n[measured]\n")[0].rstrip("\n")
    lines = [f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value:.4f}" for key, value in table.items()]
    path.write_text("\n".join((text, "", "[measured]", *lines, "")), encoding="utf-8")


def main(options: argparse.Namespace, out: Path) -> None:
    """Measure and print the table."""
    methods = parse_methods(METHODS)
    scene = scaled_view(description.merged(description.defaults(), preset_files.load_preset(SCENE)),
                   options.scale)
    truth = read_reference(renders(reference(scene, options.reference_samples).settings, out), methods, {})
    rig = scene.rig
    where = f"{SCENE} at {rig.width_px} x {rig.height_px} px"
    print(f"{where}; increase of the errors over those on an image without noise ({truth.noise:.2%} noise):")
    print(f"{'':12}{'CPU s':>8}" + "".join(f"{method.label + ' px':>10}" for method in methods)
          + f"{'SGBM wrong':>12}{'bias':>8}{'RMS':>8}")
    for name in preset_files.preset_names("qualities"):
        settings = description.merged(scene, preset_files.load_preset(name))
        found = measure(renders(settings, out), truth, methods)
        loss = found["loss"]
        print(f"{name.split('/')[1]:12}{found['cpu_s']:8.2f}"
              + "".join(f"{loss[method.label]['epe_px']:+10.3f}" for method in methods)
              + f"{100 * loss['sgbm']['wrong_or_missing']:+11.2f}%{100 * found['bias']:+7.2f}%"
              f"{100 * found['rmse']:7.2f}%", flush=True)
        if options.write:
            written(preset_files.preset_path(name), {
                "sgbm_px": loss["sgbm"]["epe_px"], "sgbm_wrong": loss["sgbm"]["wrong_or_missing"],
                "radiance_bias": found["bias"], "radiance_rms": found["rmse"], "scene": where,
                "command": f"python benchmarks/qualities.py --scale {options.scale:g} --reference-samples "
                           f"{options.reference_samples} --write"})


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--reference-samples", type=int, default=1024)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        main(given, (given.out or Path(scratch)).absolute())
