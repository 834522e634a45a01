"""Published statistics of ground and rocks. All were read in abstracts, not in the papers' tables."""

from __future__ import annotations

from dataclasses import dataclass

SCHENK = "Schenk 2009, Geophys. Res. Lett. 36, L15204, abstract"
_MICHIKAMI = "Michikami and Hagermann 2021, Icarus 357, 114282, abstract"
_CAMBIANICA = "Cambianica et al. 2019, doi 10.1051/0004-6361/201834775, abstract"


@dataclass(frozen=True)
class Range:
    """The published range of a number, and its source."""

    low: float
    high: float
    source: str

    @property
    def middle(self) -> float:
        """The middle of the range."""
        return (self.low + self.high) / 2

    @property
    def half_width(self) -> float:
        """Half the width of the range."""
        return (self.high - self.low) / 2


#: RMS slopes in degrees on Europa over 10 to 100 m: ridged plains, the matrix of chaos and deposits of craters; and
#: smooth bands, where the source says "about 5", here to the next whole degree.
EUROPA_ROUGH = Range(10.0, 15.0, SCHENK)
EUROPA_BANDS = Range(4.0, 6.0, SCHENK)

#: Indices of cumulative power laws. On comet 67P, the regions Imhotep and Hatmehit.
COMET_BLOCKS = Range(2.3, 2.7, _CAMBIANICA)
#: From the two regions of the comet over Ryugu (2.65), Itokawa (3.05) to Eros (3.25), with Eros' error of 0.14.
SMALL_BODY_BLOCKS = Range(2.3, 3.39, f"{_CAMBIANICA}; Ryugu, Itokawa and Eros: {_MICHIKAMI}")
#: Index of the widths of broken floes of sea ice.
SEA_ICE_FLOES = Range(1.7, 2.5, "Rothrock and Thorndike 1984, J. Geophys. Res. 89, 6477")

#: The rock abundance at the landing sites of Spirit and of Pathfinder, and its error, to which sites are rounded.
SPIRIT_COVER = 0.05
PATHFINDER_COVER = 0.19
COVER_ERROR = 0.02
GOLOMBEK_SITES = (
    "Golombek et al. 2003, J. Geophys. Res. 108 (E12), 8086 (Pathfinder, 19 %) and Golombek et al. 2021, doi "
    "10.1002/essoar.10507665.1 (Spirit, 5 %), abstracts"
)
GOLOMBEK_LAW = "Golombek et al. 2003, NTRS 20030111177, abstract: q = 1.79 + 0.152 / k"


def golombek_decay_per_m(k: float) -> float:
    """Return the published decay q(k) of the covered share with diameter, per metre."""
    return 1.79 + 0.152 / k
