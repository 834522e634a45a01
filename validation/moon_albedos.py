"""Albedos of the presets with Hapke's law, beside those that were measured of whole moons."""

from __future__ import annotations

from dataclasses import dataclass

from ..physics.surfaces import photometry
from ..physics.surfaces.albedos import law_of
from ..settings.description import defaults, merged
from ..settings.preset_files import load_preset
from .comparison import Bench, Comparison, Row

_VERBISCER = "Verbiscer et al. 2007, Science 315, 815, as Wikipedia quotes it"
_FILACCHIONE = "Filacchione et al. 2022, arXiv 2111.15541, abstract, 0.55 µm"
_BOLOMETRIC = ("Likely causes: it is bolometric and the preset is for 0.55 µm, and the preset's phase function is that "
               "of Enceladus, which is a guess")
_BLUE = "Likely cause: it was measured at 0.47 µm, where Europa is darker than at the preset's 0.55 µm"


@dataclass(frozen=True)
class Measured:
    """A measured albedo: ``quantity`` is geometric, Bond or equigonal, ``error`` as its authors print it."""

    preset: str
    quantity: str
    value: float
    error: float
    source: str
    fitted: bool = False
    why: str = ""


#: Errors of 0.008 and less are of the measurement alone; what five digits of a fit can meet is 0.003.
MEASURED = (
    Measured("enceladus_global", "geometric", 1.375, 0.008, _VERBISCER, fitted=True),
    Measured("enceladus_global", "Bond", 0.81, 0.04, "Howett et al. 2010, Icarus 206, 573", fitted=True),
    Measured("enceladus_global", "equigonal", 0.89, 0.03, _FILACCHIONE, fitted=True),
    Measured("enceladus_global", "geometric", 1.41, 0.04, "Verbiscer et al. 2005 at 0.555 µm, quoted; its error is a "
             "guess"),
    Measured("enceladus_south_polar", "equigonal", 0.89, 0.03, f"{_FILACCHIONE}: the whole moon", fitted=True),
    Measured("enceladus_south_polar", "Bond", 0.81, 0.04, "Howett et al. 2010: the whole moon"),
    Measured("enceladus_south_polar", "geometric", 1.375, 0.03, f"{_VERBISCER}: the whole moon; the error is a guess"),
    Measured("mimas", "equigonal", 0.63, 0.02, _FILACCHIONE, fitted=True),
    Measured("mimas", "geometric", 0.962, 0.004, _VERBISCER, fitted=True),
    Measured("mimas", "Bond", 0.41, 0.07, "Howett et al. 2020, arXiv 2003.08451, abstract: most of the moon",
             why=_BOLOMETRIC),
    Measured("mimas", "Bond", 0.45, 0.08, "the same: the anomalous region", why=_BOLOMETRIC),
    Measured("mimas", "Bond", 0.595, 0.105, "Howett et al. 2011, as the same abstract quotes it: 0.49 to 0.70"),
    Measured("tethys", "equigonal", 0.74, 0.03, _FILACCHIONE, fitted=True),
    Measured("tethys", "geometric", 1.229, 0.005, f"{_VERBISCER} and others do; its error was not read", fitted=True),
    Measured("dione", "equigonal", 0.65, 0.03, _FILACCHIONE, fitted=True),
    Measured("dione", "geometric", 0.998, 0.004, _VERBISCER, fitted=True),
    Measured("dione", "Bond", 0.63, 0.15, "Howett et al. 2010, as Howett and Royer 2021, arXiv 2102.02130, quote it"),
    Measured("dione", "Bond", 0.44, 0.13, "Howett et al. 2014, as the same quote it", why=_BOLOMETRIC),
    Measured("rhea", "equigonal", 0.60, 0.05, _FILACCHIONE, fitted=True),
    Measured("rhea", "geometric", 0.949, 0.003, _VERBISCER, fitted=True),
    Measured("rhea", "Bond", 0.59, 0.11, "Howett et al. 2014, Icarus, abstract: leading hemisphere"),
    Measured("rhea", "Bond", 0.56, 0.13, "the same: trailing hemisphere"),
    Measured("europa_global", "Bond", 0.65, 0.03, "Grundy et al. 2007 and Buratti, quoted: 0.62 to 0.68"),
    Measured("europa_global", "geometric", 0.67, 0.05, "doi 10.48577/jpl.6IR6VA, abstract, 0.47 µm: 0.72 leading, 0.62 "
             "trailing", why=_BLUE),
    Measured("europa_bright_plains", "Bond", 0.68, 0.003, "upper end of 0.62 to 0.68, as above", fitted=True),
)

_QUANTITIES = {"geometric": photometry.geometric_albedo, "Bond": photometry.bond_albedo,
               "equigonal": photometry.equigonal_albedo}


def preset_law(preset: str) -> photometry.Law:
    """The law of a shipped preset, such as ``surfaces/hapke_rhea``, which must not be Principled."""
    settings = merged(defaults(), load_preset(preset))
    law = law_of(settings.surface, settings.hapke)
    assert law is not None
    return law


def _compare(bench: Bench) -> list[Row]:
    laws = {each.preset: preset_law(f"surfaces/hapke_{each.preset}") for each in MEASURED}
    return [Row(f"`hapke_{each.preset}`, {each.quantity} albedo", _QUANTITIES[each.quantity](laws[each.preset]),
                each.value, each.error, each.source, fitted=each.fitted, why=each.why) for each in MEASURED]


COMPARISON = Comparison(
    "albedos", "Albedos of whole moons",
    "Albedos that follow from the presets with Hapke's law, by integration. The geometric albedo is the brightness of "
    "a full disc over that of a white, facing one; the Bond albedo is the share of all sunlight that is returned; the "
    "equigonal albedo is I/F at i = e = g/2, extrapolated to g = 0 without the surge. `surfaces/hapke_europa_bands`, "
    "`_ridges` and `_dark_lineae` are mixtures without a measurement of their own. `python benchmarks/fit_albedos.py` "
    "repeats the fits.", _compare)
