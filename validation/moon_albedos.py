"""Compares albedos of the presets with Hapke's law with measured albedos of whole moons."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..physics.surfaces import photometry
from ..physics.surfaces.surface_law import make_law
from ..settings.description import defaults, merged
from ..settings.preset_files import load_preset
from .comparison import Bench, Comparison, Row
from .published_spectra import read_europa_over_green

_VERBISCER = "Verbiscer et al. 2007, Science 315, 815, as Wikipedia quotes it"
_FILACCHIONE = "Filacchione et al. 2022, arXiv 2111.15541, abstract, 0.55 µm"
_BOLOMETRIC = (
    "Likely causes: it is bolometric and the preset is for 0.55 µm; and the preset has Enceladus' phase "
    "function, which is a guess"
)
_BURATTI = "Buratti et al. 2022, Planetary Science Journal 3, 200, as the program TrueColorTools quotes it"
_WHY_WIDER = "Likely cause: the preset meets the geometric albedo that was measured at the smallest phase angles"
_WHY_EARLIER = "Likely cause: two publications of one team disagree; the preset meets the later one"
_WHY_SPIKE = (
    "Likely cause: the measurement has only part of the narrow surge below 1° of phase, which Thompson and "
    "Lockwood 1992 (J. Geophys. Res. 97, abstract) call very strong. The preset has 0.75 with the surge and 0.62 "
    "without it. Another measurement, by its colour, is 0.79 at 0.55 µm. Zero point and radius are no cause: "
    "V(1,0) = -1.41, as planetarium programs quote it, gives 0.68 with a Sun of V = -26.74 and a radius of "
    "1560.8 km. The preset has 0.67 at a phase of 0.2°, 0.64 at 0.45° and 0.62 at 1°. So it shows the tables' "
    "0.64 and 0.67 near the smallest phases seen from Earth, which are less than 0.5° (Thompson and Lockwood). "
    "Open, as the publication behind the table was not found: by which phases and formula its magnitude was "
    "extrapolated to 0°"
)
_JPL = "JPL's table of satellites, V band, as Wikipedia quotes it"
_GRUNDY = "Grundy et al. 2007 and Buratti, quoted: 0.62 to 0.68"
_BOND_OVER_GEOMETRIC = "the measured Bond albedo over the geometric one, 0.65 over 0.67"
_HELFENSTEIN = "Helfenstein et al. 1998, Icarus 135, 41, abstract"
_MOON_FACT_SHEET = "an early edition of NASA's Moon Fact Sheet, as archives of it print it"
_MOON_CURVE = (
    "Allen 1976 in Krisciunas and Schaefer 1991, PASP 103, 1033; ROLO's curve (Kieffer and Stone 2005) is "
    "within 0.08 mag of it, by the web page amper.ped.muni.cz/light/luminance/moon_cal"
)
#: The same with a share of back-scattering, and with an albedo of the grains that keeps the geometric albedo.
SHARPER_LOBE = {"c": 0.6, "w": 0.2521}
_WHY_SMOOTH = (
    f"Cause: the phase function is typical and was not fitted to the curve. With c = {SHARPER_LOBE['c']:g} and w = "
    f"{SHARPER_LOBE['w']:g}, which keep the geometric albedo, all are within 0.04 mag"
)
#: Share of Europa's area that is chaos, where it was mapped.
_CHAOS_SHARE = 0.3
_WITHOUT_SURGE = (
    "Cause, by the row of the phase integral without the surge: the measured geometric albedo leaves "
    "the narrow surge out"
)


@dataclass(frozen=True)
class Measured:
    """A measured number. ``quantity`` is a key of ``_QUANTITIES``, ``error`` is as its authors print it."""

    preset: str
    quantity: str
    value: float
    error: float
    source: str
    fitted: bool = False
    why: str = ""


#: Errors of 0.008 and less are of the measurement alone; a fit with five digits can come as near as 0.003.
MEASURED = (
    Measured("enceladus_global", "geometric", 1.375, 0.008, _VERBISCER, fitted=True),
    Measured("enceladus_global", "Bond", 0.81, 0.04, "Howett et al. 2010, Icarus 206, 573", fitted=True),
    Measured("enceladus_global", "equigonal", 0.89, 0.03, _FILACCHIONE, fitted=True),
    Measured(
        "enceladus_global", "geometric", 1.41, 0.04, "Verbiscer et al. 2005 at 0.555 µm, quoted; its error is a guess"
    ),
    Measured("enceladus_global", "geometric", 1.24, 0.01, _BURATTI),
    Measured("enceladus_south_polar", "equigonal", 0.89, 0.03, f"{_FILACCHIONE}: the whole moon", fitted=True),
    Measured("enceladus_south_polar", "Bond", 0.81, 0.04, "Howett et al. 2010: the whole moon"),
    Measured("enceladus_south_polar", "geometric", 1.375, 0.03, f"{_VERBISCER}: the whole moon; the error is a guess"),
    Measured("mimas", "equigonal", 0.63, 0.02, _FILACCHIONE, fitted=True),
    Measured("mimas", "geometric", 0.962, 0.004, _VERBISCER, fitted=True),
    Measured(
        "mimas", "Bond", 0.41, 0.07, "Howett et al. 2020, arXiv 2003.08451, abstract: most of the moon", why=_BOLOMETRIC
    ),
    Measured(
        "mimas",
        "Bond",
        0.45,
        0.08,
        "Howett et al. 2020, arXiv 2003.08451, abstract: the anomalous region",
        why=_BOLOMETRIC,
    ),
    Measured("mimas", "Bond", 0.595, 0.105, "Howett et al. 2011, as Howett et al. 2020 quote it: 0.49 to 0.70"),
    Measured("tethys", "equigonal", 0.74, 0.03, _FILACCHIONE, fitted=True),
    Measured("tethys", "geometric", 1.229, 0.005, f"{_VERBISCER} and others do; its error was not read", fitted=True),
    Measured("tethys", "geometric", 0.93, 0.02, _BURATTI),
    Measured(
        "tethys",
        "equigonal",
        0.797,
        0.03,
        "Filacchione et al. 2018, Geophys. Res. Lett. 45, 6400, 0.55 µm, as "
        "TrueColorTools quotes it; the error is as in 2022",
        why=_WHY_EARLIER,
    ),
    Measured("dione", "equigonal", 0.65, 0.03, _FILACCHIONE, fitted=True),
    Measured("dione", "geometric", 0.998, 0.004, _VERBISCER, fitted=True),
    Measured("dione", "geometric", 0.75, 0.02, _BURATTI),
    Measured(
        "dione",
        "equigonal",
        0.620,
        0.03,
        "Filacchione et al. 2018, Geophys. Res. Lett. 45, 2184, 0.55 µm, as "
        "TrueColorTools quotes it; the error is as in 2022",
        why=_WHY_EARLIER,
    ),
    Measured("dione", "Bond", 0.63, 0.15, "Howett et al. 2010, as Howett and Royer 2021, arXiv 2102.02130, quote it"),
    Measured("dione", "Bond", 0.44, 0.13, "Howett et al. 2014, as Howett and Royer 2021 quote it", why=_BOLOMETRIC),
    Measured("rhea", "equigonal", 0.60, 0.05, _FILACCHIONE, fitted=True),
    Measured("rhea", "geometric", 0.949, 0.003, _VERBISCER, fitted=True),
    Measured("rhea", "geometric", 0.89, 0.01, _BURATTI),
    Measured("rhea", "phase integral", 0.71, 0.01, _BURATTI, why=_WHY_WIDER),
    Measured("rhea", "Bond", 0.59, 0.11, "Howett et al. 2014, Icarus, abstract: leading hemisphere"),
    Measured("rhea", "Bond", 0.56, 0.13, "Howett et al. 2014, Icarus, abstract: trailing hemisphere"),
    Measured("europa_global", "Bond", 0.65, 0.03, _GRUNDY),
    Measured("europa_global", "geometric", 0.67, 0.03, _JPL, why=_WHY_SPIKE),
    Measured("europa_global", "phase integral", 0.97, 0.06, _BOND_OVER_GEOMETRIC, why=_WITHOUT_SURGE),
    Measured("europa_bright_plains", "Bond", 0.68, 0.003, f"{_GRUNDY}; the upper end", fitted=True),
    Measured("lunar_like", "geometric", 0.12, 0.003, _MOON_FACT_SHEET, fitted=True),
    Measured("lunar_like", "Bond", 0.067, 0.01, f"{_MOON_FACT_SHEET}; its error is a guess"),
)

_QUANTITIES: dict[str, Callable[[photometry.Law], float]] = {
    "geometric": photometry.geometric_albedo,
    "Bond": photometry.bond_albedo,
    "equigonal": photometry.equigonal_albedo,
    "phase integral": lambda law: photometry.bond_albedo(law) / photometry.geometric_albedo(law),
}


def read_preset_photometric_law(preset: str) -> photometry.Law:
    """Read the photometric law of a shipped preset, such as ``surfaces/hapke_rhea``, which must not be Principled."""
    settings = merged(defaults(), load_preset(preset))
    law = make_law(settings.surface, settings.hapke)
    assert law is not None
    return law


def find_contradicting_measurement(each: Measured, ours: float) -> Measured | None:
    """Find another measurement of the same number that agrees with ours but contradicts this measurement: they differ
    by more than the sum of their errors. None if no measurement does.

    No number can agree with both, so a preset cannot be judged by the measurement with which it disagrees.
    """
    return next(
        (
            other
            for other in MEASURED
            if (other.preset, other.quantity) == (each.preset, each.quantity)
            and abs(other.value - each.value) > other.error + each.error
            and abs(ours - other.value) <= other.error
        ),
        None,
    )


def _make_measured_row(each: Measured) -> Row:
    ours = _QUANTITIES[each.quantity](read_preset_photometric_law(f"surfaces/hapke_{each.preset}"))
    name = each.quantity if " " in each.quantity else f"{each.quantity} albedo"
    other = find_contradicting_measurement(each, ours)
    return Row(
        f"`hapke_{each.preset}`, {name}",
        ours,
        each.value,
        each.error,
        each.source,
        fitted=each.fitted,
        why=each.why,
        unjudged=f"another measurement, {other.value:g} ± {other.error:g}, contradicts it" if other else "",
    )


def _magnitudes_per_degree(law: photometry.Law, near_deg: float, far_deg: float) -> float:
    near, far = photometry.disc_brightness(law, np.radians([near_deg, far_deg]))
    return float(2.5 * np.log10(near / far) / (far_deg - near_deg))


def compute_radiance_factor_at_5_deg(law: photometry.Law) -> float:
    """Compute I/F of ground that is lit along its normal, at an emission and phase angle of 5°."""
    return float(np.pi * law(np.zeros(1), np.radians([5.0]), np.zeros(1))[0])


def compute_opposition_effect(law: photometry.Law) -> float:
    """Compute the increase of I/F from an emission and phase angle of 5° to 0°, as a share, for ground that is lit
    along its normal."""
    five, none = law(np.zeros(2), np.radians([5.0, 0.0]), np.zeros(2))
    return float(none / five - 1)


def compute_albedo_without_surge(law: photometry.Law) -> float:
    """Compute the geometric albedo by a line through the magnitudes at phases of 1.5° to 12°, as seen from Earth."""
    phases = np.linspace(1.5, 12.0, 8)
    magnitudes = -2.5 * np.log10(photometry.disc_brightness(law, np.radians(phases)))
    return float(10 ** (-0.4 * np.polyfit(phases, magnitudes, 1)[1]))


def _make_europa_rows() -> list[Row]:
    """Make rows of the published numbers of Europa, other than albedos at the presets' 0.55 µm."""
    whole, plains, dark = (
        read_preset_photometric_law(f"surfaces/hapke_europa_{name}")
        for name in ("global", "bright_plains", "dark_lineae")
    )
    return [
        *_make_surgeless_rows(whole),
        *_make_phase_coefficient_rows(whole),
        *_make_opposition_rows(whole, plains, dark),
        *_make_mixed_rows("ridges", 0.25, plains, dark, ""),
        *_make_mixed_rows(
            "bands",
            0.5,
            plains,
            dark,
            "Likely cause: chaos, whose darkness was not measured, is brighter "
            "than ground with half dark material; with bands on up to 22 % of the disc it has the measured "
            "0.62 or more",
        ),
    ]


def _make_surgeless_rows(whole: photometry.Law) -> list[Row]:
    """Make rows of Europa's geometric albedo without the narrow surge, and in blue light."""
    colour, error = read_europa_over_green(470.0)
    extrapolated = compute_albedo_without_surge(whole)
    return [
        Row(
            "`hapke_europa_global`, geometric albedo, in a line from phases of 1.5° to 12°",
            extrapolated,
            0.67,
            0.03,
            _JPL,
            why="Likely cause: the measured albedo has part of the surge; it is between this one and the one "
            "with all of it",
        ),
        Row(
            "`hapke_europa_global`, geometric albedo, in a line from phases of 1.5° to 12°",
            extrapolated,
            0.64,
            0.03,
            "Hamilton's Views of the Solar System, another table; the error is as for JPL's",
        ),
        Row(
            "`hapke_europa_global`, phase integral with this albedo",
            photometry.bond_albedo(whole) / extrapolated,
            0.97,
            0.06,
            _BOND_OVER_GEOMETRIC,
        ),
        Row(
            f"`hapke_europa_global`, geometric albedo at 0.47 µm, by the colour {colour:.3f} of the trailing side",
            photometry.geometric_albedo(whole) * colour,
            0.67,
            0.05,
            f"doi 10.48577/jpl.6IR6VA, abstract: 0.72 leading, 0.62 trailing; colour: see Colours, ± {error:.3f}",
        ),
    ]


def _make_phase_coefficient_rows(whole: photometry.Law) -> list[Row]:
    return [
        Row(
            "`hapke_europa_global`, phase coefficient from 1.5° to 7°",
            _magnitudes_per_degree(whole, 1.5, 7.0),
            0.01,
            0.005,
            "Buratti et al. 2002, DPS 34, 41.06, abstract: as in the visible; one digit",
            unit="mag/°",
        ),
        Row(
            "`hapke_europa_global`, phase coefficient from 0.38° to 0.6°",
            _magnitudes_per_degree(whole, 0.38, 0.6),
            0.25,
            0.03,
            "Buratti et al. 2002, DPS 34, 41.06, abstract, 0.9 µm; the error is a guess",
            unit="mag/°",
            why="Likely causes: the surge in the infrared is another one, and the published fit has too weak a surge, "
            "see the opposition effect of `hapke_europa_bright_plains`",
        ),
    ]


def _make_opposition_rows(whole: photometry.Law, plains: photometry.Law, dark: photometry.Law) -> list[Row]:
    """Make rows of the brightness and slope of Europa's terrains near zero phase."""
    return [
        Row(
            "`hapke_europa_bright_plains`, opposition effect over that of `hapke_europa_global`",
            compute_opposition_effect(plains) / compute_opposition_effect(whole),
            1.5,
            0.1,
            f"{_HELFENSTEIN}: about 1.5 times what was known before; the error is a guess",
            fitted=True,
        ),
        Row(
            "`hapke_europa_dark_lineae`, I/F at emission and phase 5°",
            compute_radiance_factor_at_5_deg(dark),
            0.17,
            0.005,
            f"{_HELFENSTEIN}, 0.56 µm",
            fitted=True,
        ),
        Row(
            "`hapke_europa_dark_lineae`, opposition effect over that of `hapke_europa_bright_plains`",
            compute_opposition_effect(dark) / compute_opposition_effect(plains),
            3.0,
            1.0,
            f"{_HELFENSTEIN}: up to four times for the darkest spots, by shadow hiding; taken as 2 to 4",
        ),
    ]


def _make_mixed_rows(name: str, share: float, plains: photometry.Law, dark: photometry.Law, why: str) -> list[Row]:
    """Make rows of a mixed terrain: the number to which it was fitted, and the nearest measured ones."""
    law, preset = read_preset_photometric_law(f"surfaces/hapke_europa_{name}"), f"`hapke_europa_{name}`"
    mixed = (1 - share) * compute_radiance_factor_at_5_deg(plains) + share * compute_radiance_factor_at_5_deg(dark)
    disc = (1 - _CHAOS_SHARE) * photometry.bond_albedo(plains) + _CHAOS_SHARE * photometry.bond_albedo(law)
    return [
        Row(
            f"{preset}, I/F at emission and phase 5°",
            compute_radiance_factor_at_5_deg(law),
            mixed,
            0.003,
            f"no measurement: "
            f"`_bright_plains` with {share:.0%} of `_dark_lineae`, as Clark et al. 1998 (Icarus 135, 95, abstract) "
            "mix them; the share is chosen",
            fitted=True,
        ),
        Row(
            f"{preset}, opposition effect over that of `hapke_europa_bright_plains`",
            compute_opposition_effect(law) / compute_opposition_effect(plains),
            2.5,
            1.5,
            f"{_HELFENSTEIN}: between bright icy terrains, 1, and the darkest spots, up to 4",
        ),
        Row(
            f"{preset} on {_CHAOS_SHARE:.0%} of a disc of `hapke_europa_bright_plains`: Bond albedo",
            disc,
            0.65,
            0.03,
            f"{_GRUNDY}, the whole moon; share: chaos is nearly 30 % of the area that Riley et al. 2000 "
            f"mapped (J. Geophys. Res. 105, 22599, abstract); that chaos is as dark as {name} is a guess",
            why=why,
        ),
    ]


def _make_lunar_rows() -> list[Row]:
    """Make rows of the Moon's phase curve, without any fit. They begin at 30°, because the curve has no surge below
    that."""
    law = read_preset_photometric_law("surfaces/hapke_lunar_like")
    phases = np.array([30.0, 60.0, 90.0, 120.0])
    ours = -2.5 * np.log10(photometry.disc_brightness(law, np.radians(phases)))
    theirs = 0.026 * phases + 4e-9 * phases**4
    return [
        Row(
            f"`hapke_lunar_like`, magnitude at a phase of {phase:.0f}° less that at 30°",
            here - ours[0],
            there - theirs[0],
            0.08,
            _MOON_CURVE,
            unit="mag",
            why=_WHY_SMOOTH,
        )
        for phase, here, there in zip(phases[1:], ours[1:], theirs[1:], strict=True)
    ]


def _compare_albedos(bench: Bench) -> list[Row]:
    return [*map(_make_measured_row, MEASURED), *_make_europa_rows(), *_make_lunar_rows()]


COMPARISON = Comparison(
    "albedos",
    "Albedos of whole moons",
    "Each albedo follows from a preset by integration of Hapke's law. `python benchmarks fit_albedos` "
    "repeats the fits.\n\n"
    "* The geometric albedo is the brightness of a full disc over the brightness of a white disc that faces the "
    "Sun.\n"
    "* The Bond albedo is the share of all sunlight that is returned.\n"
    "* The equigonal albedo is I/F at i = e = g/2, extrapolated to g = 0 without the surge.\n\n"
    "`surfaces/hapke_europa_ridges` and `_bands` were fitted to mixtures of our own. No measurement of either "
    "alone was found. Helfenstein et al. 1998 measured four materials. Belgacem et al. 2020 (arXiv 2007.11445) "
    "and Mergny et al. 2025 (Astron. Astrophys. 693, L21) measured twenty regions, whose numbers were not read. "
    "The rows of both presets have the nearest published number.\n\n"
    "`surfaces/hapke_europa_global` is the published fit to the whole disc and not good for its parts. Galileo "
    "saw limbs brighter and the middle of the disc darker than this fit, at 0.42 and 0.56 µm and a phase of "
    "2.1° (Clark et al. 1997, DPS 29, abstract, which has no numbers).",
    _compare_albedos,
)
