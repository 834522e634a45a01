"""The figures of the manual, each drawn by the code that it illustrates.

The same code gives the same bytes: no date, no random ids, letters as outlines.
"""

from __future__ import annotations

import io
import json
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from cycler import cycler
from icymoon.physics.camera import depth_accuracy, sensor
from icymoon.physics.lidar import light_in_ice
from icymoon.physics.light import ephemeris, photons, planetshine
from icymoon.physics.light.sunlight import sun_diameter_deg, sun_irradiance_wm2
from icymoon.physics.random_numbers.seeds import make_generator
from icymoon.physics.rig.focal_length import focal_px
from icymoon.physics.rocks import size_laws
from icymoon.physics.surfaces import photometry, surface_law
from icymoon.physics.surfaces.hapke import bidirectional_reflectance
from icymoon.physics.terrain import terrain as grounds
from icymoon.physics.terrain.roughness import statistics
from icymoon.settings import description, preset_files
from icymoon.settings.topics.scene import Settings
from icymoon.stereo.measure.metrics import compute_depth_metrics, compute_disparity_metrics, compute_total_metrics
from icymoon.stereo.trade.quality_losses import find_pareto_front
from icymoon.support.version import ROOT
from matplotlib import rc_context
from matplotlib.figure import Figure

COLOURS = ("#1b6ca8", "#c2553a", "#2a9d5c", "#7a6fc2", "#d19a1d", "#3fa7d6", "#8c2f39", "#777777")
STYLE: Any = {
    "svg.hashsalt": "icymoon",
    "svg.fonttype": "path",
    "font.size": 9,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.prop_cycle": cycler(color=COLOURS),
    "lines.linewidth": 1.4,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
}


def described(*presets: str, **topics: dict[str, Any]) -> Settings:
    """The defaults with presets and changes."""
    return description.merged(
        description.defaults(),
        *(preset_files.load_preset(name) for name in presets),
        description.check(topics, "figure"),
    )


def terrain_law(figure: Figure) -> None:
    """Stated and measured RMS deviation over distance."""
    axes = figure.subplots()
    axis = np.linspace(-10, 10, 513)
    for hurst, colour in zip((0.5, 0.7, 0.9), COLOURS, strict=False):
        shown = described(terrain={"hurst": hurst})
        ground = shown.terrain
        spacing = axis[1] - axis[0]
        heights = grounds.make_terrain(shown, 1).heights(axis[None, :], axis[:, None], 2 * spacing)
        low, high = grounds.law_range_m(ground)
        found = statistics.measure_roughness(heights, spacing, ground.slope_baseline_m, (max(low, 6 * spacing), high))
        law = np.geomspace(low, high, 20)
        stated = math.tan(math.radians(ground.rms_slope_deg)) * law**hurst
        axes.loglog(found.lag_m, found.deviation_m, "o", ms=3.5, color=colour, label=f"H {hurst}: measured")
        axes.loglog(law, stated, "-", color=colour, label=f"H {hurst}: stated")
    axes.axvline(2 * spacing, color="#777777", ls=":", lw=1)
    axes.set(xlabel="Distance between two points, m", ylabel="RMS difference of their heights, m")
    axes.legend(ncols=3, fontsize=8)


def terrain_profiles(figure: Figure) -> None:
    """Cuts through the ground for three Hurst exponents with the same RMS slope."""
    rows = figure.subplots(3, sharex=True, sharey=True)
    x = np.linspace(-5, 5, 1001)
    for axes, hurst, colour in zip(rows, (0.5, 0.7, 0.9), COLOURS, strict=False):
        made = grounds.make_terrain(described(terrain={"hurst": hurst}), 1)
        axes.fill_between(x, made.heights(x, np.zeros_like(x)), -3, color=colour, lw=0)
        axes.set(ylim=(-1.6, 1.0), ylabel=f"H {hurst}\nheight, m", xlim=(-5, 5))
    rows[-1].set_xlabel("East, m")


def rock_sizes(figure: Figure) -> None:
    """Rocks per square metre above a diameter: the laws of the rock presets and the rocks drawn from them."""
    axes = figure.subplots()
    area = 400.0
    for name, colour in zip(preset_files.preset_names("rocks"), COLOURS, strict=False):
        shown = described(name)
        law = size_laws.make_size_law(shown.rocks)
        diameters, _ = size_laws.draw_diameters(law, area, shown.rocks.most, make_generator(1, "rocks"))
        step = max(1, len(diameters) // 60)
        axes.loglog(diameters[::step], (np.arange(len(diameters)) + 1)[::step] / area, "o", ms=3, color=colour)
        d = np.geomspace(law.smallest_m, 0.999 * shown.rocks.largest_m, 80)
        axes.loglog(d, law.per_m2_above(d), "-", color=colour, label=preset_files.read_preset_header(name)[0])
    axes.set(xlabel="Diameter, m", ylabel="Rocks per m² above it", ylim=(1 / area / 2, None))
    axes.legend(fontsize=8)


def hapke_phase(figure: Figure) -> None:
    """Brightness of a sphere over phase angle for the presets with Hapke's law."""
    near, far = figure.subplots(1, 2)
    for name in (n for n in preset_files.preset_names("surfaces") if "hapke" in n):
        shown = described(name)
        law = surface_law.make_law(shown.surface, shown.hapke)
        assert law is not None
        for axes, last in ((near, 8.0), (far, 160.0)):
            phase = np.radians(last) * np.linspace(0, 1, 81) ** 2
            axes.plot(
                np.degrees(phase),
                photometry.disc_brightness(law, phase),
                label=preset_files.read_preset_header(name)[0].removesuffix(" (Hapke)"),
            )
    near.set(xlabel="Phase angle, °", ylabel="Brightness over a white, facing disc", ylim=(0, None))
    far.set(xlabel="Phase angle, °", ylim=(0, None))
    far.legend(fontsize=7)


def hapke_error(figure: Figure) -> None:
    """Relative error of the double-precision implementation against the 50-digit table of the tests."""
    sys.path.insert(0, str(ROOT / "tests" / "support"))
    import hapke_table

    axes = figure.subplots()
    errors = []
    for row in hapke_table.rows():
        true = float(row["r"])
        incidence, emission, azimuth = hapke_table.angles(row)
        found = float(bidirectional_reflectance(incidence, emission, azimuth, hapke_table.parameters(row)))
        errors.append(abs(found / true - 1) if true else abs(found))
    axes.hist(np.log10(np.maximum(errors, 1e-17)), bins=[k / 4 for k in range(-68, -46)], color=COLOURS[0])
    axes.axvline(-12, color=COLOURS[1], label="limit of the test")
    axes.set(xlabel="log10 of the relative error of r (-17: none)", ylabel=f"Number of rows (of {len(errors)})")
    axes.legend()


def hapke_roughness(figure: Figure) -> None:
    """Reflectance along the principal plane for three roughnesses, of a plane lit from 60 degrees."""
    axes = figure.subplots()
    emission = np.linspace(-85, 85, 341)
    for theta in (0.0, 10.0, 25.0):
        shown = described("surfaces/hapke_europa_global", hapke={"theta_bar_deg": theta})
        law = surface_law.make_law(shown.surface, shown.hapke)
        assert law is not None
        r = law(np.radians(60.0), np.radians(np.abs(emission)), np.where(emission > 0, 0.0, math.pi))
        axes.plot(emission, math.pi * np.asarray(r), label=f"roughness {theta:g}°")
    lambert = surface_law.make_law(described(surface={"model": "LAMBERT", "albedo": 0.7}).surface, described().hapke)
    assert lambert is not None
    axes.plot(
        emission,
        math.pi * np.asarray(lambert(np.radians(60.0), np.radians(np.abs(emission)), 0.0 * emission)),
        "--",
        color="#777777",
        label="Lambert, albedo 0.7",
    )
    axes.set(xlabel="Emission angle in the plane of the Sun, ° (Sun at +60)", ylabel="I/F", ylim=(0, None))
    axes.legend(fontsize=8)


def sun_at_distance(figure: Figure) -> None:
    """Irradiance and apparent diameter of the Sun over distance."""
    left, right = figure.subplots(1, 2)
    au = np.geomspace(0.9, 12, 200)
    left.loglog(au, [sun_irradiance_wm2(d) for d in au])
    right.loglog(au, [sun_diameter_deg(d) for d in au])
    for name, d in (("Earth", 1.0), ("Jupiter", 5.2038), ("Saturn", 9.583)):
        for axes, value, digits in ((left, sun_irradiance_wm2(d), 2), (right, sun_diameter_deg(d), 4)):
            axes.plot(d, value, "o", color=COLOURS[1])
            axes.annotate(
                f"{name} {value:.{digits}f}",
                (d, value),
                (-6, -10) if d > 1 else (6, 0),
                fontsize=8,
                textcoords="offset points",
                ha="right" if d > 1 else "left",
            )
    left.set(xlabel="Distance, au", ylabel="Irradiance, W/m²")
    right.set(xlabel="Distance, au", ylabel="Diameter, °")


def europa_day(figure: Figure) -> None:
    """Sun and Jupiter over one site on Europa during one orbit about Jupiter."""
    height, bright = figure.subplots(2, sharex=True)
    hours = np.arange(0, 85.3, 0.5)
    sun, phase = [], []
    for hour in hours:
        date = f"2035-03-{1 + int(hour // 24):02d}T{int(hour % 24):02d}:{int(60 * (hour % 1)):02d}:00"
        at = ephemeris.find_positions("EUROPA", date, 10.0, 331.0)
        sun.append(math.degrees(math.asin(at.sun[2])))
        phase.append(math.degrees(math.acos(float(np.clip(-(at.planet @ at.sun), -1, 1)))))
    jupiter = math.degrees(math.asin(at.planet[2]))
    height.plot(hours, sun, label="Sun")
    height.axhline(jupiter, color=COLOURS[1], label="Jupiter")
    height.axhline(0, color="#444444", lw=0.8)
    height.set(ylabel="Elevation, °")
    height.legend(fontsize=8, ncols=2)
    bright.plot(hours, phase, color=COLOURS[1])
    bright.set(ylabel="Jupiter's phase angle, °", xlabel="Hours since 2035-03-01 00:00 UTC")


def planet_phase(figure: Figure) -> None:
    """The planets' phase functions."""
    axes = figure.subplots()
    phase = np.linspace(0, 178, 357)
    for law in ("LAMBERT", "SATURN", "JUPITER"):
        axes.semilogy(phase, [planetshine.phase_function(law, a) for a in phase], label=law)
    axes.set(xlabel="Phase angle, °", ylabel="Brightness over full phase", ylim=(1e-3, 1.2))
    axes.legend()


def photon_transfer(figure: Figure) -> None:
    """Signal-to-noise ratio over signal: drawn images and the formula."""
    axes = figure.subplots()
    for k, name in enumerate(preset_files.preset_names("sensors")):
        response = described(name).sensor
        well, read, prnu = (float(response[key]) for key in ("full_well_e", "read_noise_e", "prnu"))
        signal = np.geomspace(10, 0.9 * well, 25)
        measured = []
        for j, electrons in enumerate(signal):
            light = np.full((128, 128), electrons)
            pattern = sensor.draw_pattern(1, "left", (128, 128), response)
            drawn = sensor.collect_electrons(
                light, 1.0, 1.0, response | {"dark_current_e_s": 0.0}, make_generator(1, "sensor", j), pattern
            )
            measured.append(drawn.mean() / drawn.std())
        dsnu = float(response.dsnu_e)
        noise = np.sqrt(signal + read**2 + (prnu * signal) ** 2 + dsnu**2)
        axes.loglog(signal, measured, "o", ms=3.5, color=COLOURS[k])
        axes.loglog(signal, signal / noise, color=COLOURS[k], label=preset_files.read_preset_header(name)[0])
    axes.set(xlabel="Photo-electrons", ylabel="Signal over noise")
    axes.legend(fontsize=8)


def exposure_response(figure: Figure) -> None:
    """Digital number over exposure time for snow under the Suns of Enceladus and Europa."""
    axes = figure.subplots()
    shown = described("sensors/default", "rigs/guiss")
    response, rig = shown.sensor, shown.rig
    pitch = photons.pixel_pitch_m(response, rig)
    seconds = np.geomspace(1e-7, 1e-2, 200)
    for name, irradiance in (("Enceladus", 14.82), ("Europa", 50.26)):
        # Level Lambert ground of albedo 0.8, the Sun 30 degrees high.
        radiance = 0.8 * irradiance * math.sin(math.radians(30)) / math.pi
        rate = photons.electron_rate(shown.light, response, pitch)
        charge = np.minimum(radiance * rate * seconds, response.full_well_e)
        axes.semilogx(1e3 * seconds, sensor.convert_to_digital(charge, response), label=name)
    axes.set(xlabel="Exposure, ms", ylabel="Digital number of level ground")
    axes.legend()


def depth_error(figure: Figure) -> None:
    """Depth error over depth of the shipped rigs, for a quarter of a pixel."""
    axes = figure.subplots()
    depth = np.geomspace(0.5, 50, 100)
    for k, name in enumerate(preset_files.preset_names("rigs")):
        rig, title = described(name).rig, preset_files.read_preset_header(name)[0]
        axes.loglog(
            depth,
            [100 * depth_accuracy.depth_error_m(z, rig, 0.25) for z in depth],
            "-" if k % 2 else "--",
            label=f"{title}, f·B {focal_px(rig) * rig.baseline_m:.0f} px·m",
        )
    axes.set(xlabel="Depth, m", ylabel="Depth error for 0.25 px, cm")
    axes.legend(fontsize=8)


def cautious_matcher(figure: Figure) -> None:
    """A matcher that leaves out its worst pixels: the error of measured pixels falls, that of all pixels does not."""
    axes = figure.subplots()
    random = make_generator(1, "sensor", 99)
    focal_baseline = 85.333
    truth = random.uniform(1.0, 6.0, 20000)
    off = np.abs(random.standard_t(2.0, truth.size)) * 0.4
    disparity = focal_baseline / truth + off
    order = np.argsort(off)
    kept = np.linspace(0.3, 1.0, 29)
    rows = []
    for share in kept:
        chosen = np.full(truth.size, np.nan)
        index = order[: round(share * truth.size)]
        chosen[index] = disparity[index]
        depth = focal_baseline / chosen
        measured = compute_depth_metrics(depth, truth) | compute_disparity_metrics(chosen, focal_baseline / truth)
        total = compute_total_metrics(depth, truth, chosen, focal_baseline / truth, measured["dod"])
        rows.append((measured["bad_1"], total["bad_1"], measured["dod"], total["dod"]))
    for column, (label, style, colour) in zip(
        np.array(rows).T,
        (("bad_1", "-", 0), ("total_bad_1", "--", 0), ("dod", "-", 1), ("total_dod", "--", 1)),
        strict=True,
    ):
        axes.plot(100 * kept, 100 * column, style, color=COLOURS[colour], label=label)
    axes.set(xlabel="Coverage, %", ylabel="%", ylim=(0, None))
    axes.legend()


def trade_front(figure: Figure) -> None:
    """Extra disparity error over processor seconds, for the variants in ``trade.json`` beside this file."""
    report = json.loads((Path(__file__).parent / "trade.json").read_text(encoding="utf-8"))
    kinds = {
        row["key"]: row["name"] if row["group"] == "scene" else row["name"].partition(", ")[2] or "not denoised"
        for row in report["rows"]
    }
    panels = figure.subplots(1, 2, sharey=True)
    for axes, method in zip(panels, ("sgbm", "bm"), strict=True):
        for kind, colour in zip(dict.fromkeys(kinds.values()), COLOURS, strict=False):
            rows = [row for row in report["rows"] if kinds[row["key"]] == kind]
            axes.loglog(
                [row["cpu_s"] for row in rows],
                [row["loss"][method]["epe_px"] for row in rows],
                "o",
                ms=4,
                color=colour,
                label=kind,
            )
        best = [report["rows"][k] for k in find_pareto_front(report["rows"], ("loss", method, "epe_px"))]
        axes.loglog(
            [row["cpu_s"] for row in best],
            [row["loss"][method]["epe_px"] for row in best],
            "-",
            color="#777777",
            lw=1,
            zorder=0,
        )
        axes.set(xlabel="Processor seconds of a pair", title=method, ylim=(0.003, 3.0))
        axes.set_xticks((2, 5, 10, 20), ("2", "5", "10", "20"))
        axes.set_xticks((), minor=True)
    panels[0].set(ylabel="Extra disparity error, px")
    panels[0].legend(fontsize=8)


def fusion_curves(figure: Figure) -> None:
    """Share of pixels off by more than 1 px over the number of range points, for the scenes of ``fusion.json``."""
    scenes = json.loads((Path(__file__).parent / "fusion.json").read_text(encoding="utf-8"))
    shown = ("rough ice", "very high relief", "rough ice, weak light")
    for axes, title in zip(figure.subplots(1, len(shown), sharey=True), shown, strict=True):
        scene = scenes[title]
        axes.axhline(scene["stereo"][0], color="#777777", ls=":", label="SGBM")
        for kind, label in (("interpolation", "interpolation"), ("fill", "SGBM, filled"), ("pick", "SGBM + LiDAR")):
            axes.loglog(scene["points"], [scene[kind][str(count)][0] for count in scene["points"]], label=label)
        axes.set(xlabel="Range points", title=title)
    figure.axes[0].set(ylabel="Off by more than 1 px, %")
    figure.axes[0].legend(fontsize=8)


def ice_waveforms(figure: Figure) -> None:
    """Received power of a laser pulse on a hard surface, on snow and on bubbly ice."""
    columns = figure.subplots(1, 2, sharey=True, sharex=True)
    receiver = light_in_ice.Receiver(1e-9, gate_m=1.2)
    for axes, wavelength in zip(columns, (532.0, 905.0), strict=True):
        fine = light_in_ice.make_snow(50e-6, 200.0, wavelength)
        for title, medium in (
            ("hard surface", light_in_ice.Medium("hard", 0.0, 0.0, 0.0)),
            ("plume snow, 50 µm", fine),
            ("coarse snow, 1 mm", light_in_ice.make_snow(1e-3, 500.0, wavelength)),
            ("bubbly ice, l* 5 cm", light_in_ice.make_bubbly_ice(5e-4, 0.063, wavelength)),
        ):
            wave = light_in_ice.make_waveform(medium, receiver)
            axes.plot(wave.range_m[::8], wave.power[::8], label=title)
        axes.axvline(0.0, color="#777777", ls=":", lw=1)
        axes.set(xlabel="Apparent range behind the surface, m", title=f"{wavelength:g} nm", xlim=(-0.25, 1.0), ylim=0)
    columns[0].set(ylabel="Received power, 1/m")
    columns[0].legend(fontsize=8)


FIGURES: dict[str, Callable[[Figure], None]] = {
    f.__name__: f
    for f in (
        terrain_law,
        terrain_profiles,
        rock_sizes,
        hapke_phase,
        hapke_error,
        hapke_roughness,
        sun_at_distance,
        europa_day,
        planet_phase,
        photon_transfer,
        exposure_response,
        ice_waveforms,
        depth_error,
        cautious_matcher,
        trade_front,
        fusion_curves,
    )
}


#: A number with more digits than a screen shows. Those of a scale make small letters of large outlines, and stay.
_LONG_NUMBER = re.compile(r"scale\([^)]*\)|-?\d+\.\d{3,}")


def _rounded(found: re.Match[str]) -> str:
    return found[0] if found[0].startswith("scale") else f"{float(found[0]):.2f}".rstrip("0").rstrip(".")


#: The name that Matplotlib gives to a marker or a clip path: a hash of how this NumPy writes its numbers.
_HASH = re.compile(r"\b[mp][0-9a-f]{10}\b")


def _plain(text: str) -> str:
    """A drawing with rounded numbers, and with names in the order in which they appear."""
    names: dict[str, str] = {}
    numbered = _HASH.sub(lambda found: names.setdefault(found[0], f"shape{len(names) + 1}"), text)
    return _LONG_NUMBER.sub(_rounded, numbered)


def svg(name: str) -> bytes:
    """A figure as SVG, in hundredths of a point."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 3.6))
        FIGURES[name](figure)
        stream = io.BytesIO()
        figure.savefig(stream, format="svg", metadata={"Date": None})
    return _plain(stream.getvalue().decode()).encode()
