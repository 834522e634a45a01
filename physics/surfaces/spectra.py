"""Reflectance by wavelength of materials on the ground of icy moons, in the visible, 400 to 700 nm.

Snow is computed from the absorption of pure ice. The other materials are tables, because no spectrum of them at the
scale of a lander's camera is published. A table has the known facts about the colour; ``Material.source`` states which
numbers are measured, which are assumed (from memory, without a publication at hand), and which are a guess.
``validation`` compares snow and the grounds of both moons with published spectra. ``light.bands`` multiplies spectra
with sunlight. All reflectances are bihemispherical: the share of even light from all sides that flat ground returns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array, Numbers

ICE_KG_M3 = 917.0

#: Imaginary part of the refractive index of ice at -7 °C, at 400 to 700 nm in steps of 10 nm: Warren and Brandt 2008,
#: J. Geophys. Res. 113, D14220. Below 600 nm others find up to ten times more absorption in the blue, because their
#: snow was less pure (Picard et al. 2016, The Cryosphere 10, 2655): the reflectance in the blue is an upper limit here.
_ICE_NM = np.arange(400.0, 701.0, 10.0)
_ICE_K = np.array(
    [
        2.365e-11,
        2.669e-11,
        3.135e-11,
        4.140e-11,
        6.268e-11,
        9.239e-11,
        1.325e-10,
        1.956e-10,
        2.861e-10,
        4.172e-10,
        5.889e-10,
        8.036e-10,
        1.076e-9,
        1.409e-9,
        1.813e-9,
        2.289e-9,
        2.839e-9,
        3.461e-9,
        4.159e-9,
        4.930e-9,
        5.730e-9,
        6.890e-9,
        8.580e-9,
        1.040e-8,
        1.220e-8,
        1.430e-8,
        1.660e-8,
        1.890e-8,
        2.090e-8,
        2.400e-8,
        2.900e-8,
    ]
)

#: Factor on the absorption by the shape of snow's grains, B = 1.6: Libois et al. 2014, Journal of Glaciology 60, 498.
ABSORPTION_ENHANCEMENT = 1.6
#: Asymmetry g of scattering by snow's grains; 0.845 fits the absorption of real snow (the same source).
SNOW_ASYMMETRY = 0.845
BUBBLE_ASYMMETRY = 0.79


def ice_absorption_1_m(wavelength_nm: Numbers) -> Array:
    """Compute the absorption coefficient 4πk/λ of pure ice in 1/m, interpolated in logarithms; beyond 400 to 700 nm, k
    is constant.
    """
    wavelength = np.asarray(wavelength_nm, np.float64)
    k = np.exp(np.interp(np.log(wavelength), np.log(_ICE_NM), np.log(_ICE_K)))
    return np.asarray(4 * np.pi * k / (wavelength * 1e-9))


def snow_reflectance(wavelength_nm: Numbers, grain_radius_m: float) -> Array:
    """Compute the reflectance of deep, clean snow in even light: exp(-√(16/3 · (1 - ω)/(1 - g))).

    ``grain_radius_m`` is the radius r of spheres with the snow's surface per mass, SSA = 3 / (917 kg/m³ · r). The
    single-scattering co-albedo is 1 - ω = 2Bα / (917 · SSA) (Kokhanovsky and Zege 2004, Applied Optics 43, 1589; Libois
    et al. 2013, The Cryosphere 7, 1803). The formula is accurate while 1 - ω is small, as it is in the visible below a
    radius of some centimetres. Another program, with the same absorption, agrees within 0.005 for radii of 100 and 500
    µm, and is up to 0.059 darker at 700 nm for firn of 2.5 mm. For this firn, the formula with twice the radius agrees
    with it within 0.011 (`icymoon validate --only colours`).
    """
    surface_per_mass = 3 / (ICE_KG_M3 * grain_radius_m)
    coalbedo = 2 * ABSORPTION_ENHANCEMENT * ice_absorption_1_m(wavelength_nm) / (ICE_KG_M3 * surface_per_mass)
    return np.asarray(np.exp(-np.sqrt(16 / 3 * coalbedo / (1 - SNOW_ASYMMETRY))))


def bubbly_ice_reflectance(wavelength_nm: Numbers, bubble_radius_m: float, bubble_share: float) -> Array:
    """Compute the reflectance of deep, clean ice with air bubbles in even light, without reflection at its surface.

    It is exp(-4 √(α (1 - f) · 4a/3 / (3 f (1 - g)))): the same asymptotic radiative transfer as for snow, with bubbles
    of radius a and volume share f as scatterers, as in the package snowoptics 0.99.2. g = 0.79 is the asymmetry of
    spherical bubbles in geometric optics, without the light that is diffracted. The fewer and larger the bubbles are,
    the further light travels in ice between them, and the bluer the ice is.
    """
    absorbed = ice_absorption_1_m(wavelength_nm) * (1 - bubble_share)
    scattered = 3 * bubble_share * (1 - BUBBLE_ASYMMETRY) / (4 / 3 * bubble_radius_m)
    return np.asarray(np.exp(-4 * np.sqrt(absorbed / scattered)))


@dataclass(frozen=True)
class Material:
    """A spectrum, linear between its wavelengths and constant beyond the first and the last."""

    title: str
    wavelength_nm: tuple[float, ...]
    values: tuple[float, ...]  # reflectances
    source: str  # of its numbers: which are published, which are assumed, which are a guess

    def reflectance(self, wavelength_nm: Numbers) -> Array:
        """Interpolate the reflectances at wavelengths in nm, in the shape of the wavelengths."""
        return np.asarray(np.interp(np.asarray(wavelength_nm, np.float64), self.wavelength_nm, self.values))


#: Wavelengths of tables that only describe a colour: violet, blue, green, orange, red.
_COLOUR_NM = (400.0, 460.0, 550.0, 620.0, 700.0)


def _make_coloured(title: str, green: float, over_green: tuple[float, float, float, float], source: str) -> Material:
    """Make a material with the reflectance ``green`` at 550 nm; ``over_green`` are its other reflectances over
    ``green``.
    """
    violet, blue, orange, red = over_green
    return Material(title, _COLOUR_NM, tuple(green * part for part in (violet, blue, 1.0, orange, red)), source)


def _make_with_band(title: str, level: float, depth: float, centre_nm: float, fwhm_nm: float, source: str) -> Material:
    """Make a grey material with one Gaussian absorption band."""
    wavelength = np.arange(400.0, 701.0, 10.0)
    band = np.exp(-4 * np.log(2) * ((wavelength - centre_nm) / fwhm_nm) ** 2)
    return Material(title, tuple(wavelength.tolist()), tuple((level * (1 - depth * band)).tolist()), source)


#: Materials by their names in the settings. Numbers called a guess or assumed should be replaced by measurements as
#: these appear.
MATERIALS: dict[str, Material] = {
    "ENCELADUS_PLAINS": _make_coloured(
        "Plains of Enceladus",
        0.9,
        (0.98, 0.99, 0.99, 0.985),
        "Flat through the visible and into the ultraviolet (Buratti 1984, Icarus 59, 392); ratios assumed. Cassini "
        "measured up to 0.02 less toward red and violet. Level: a guess, near the high albedo of the moon; "
        "surface.albedo replaces it",
    ),
    "EUROPA_PLAINS": _make_coloured(
        "Bright plains of Europa",
        0.7,
        (0.76, 0.88, 1.04, 1.06),
        "Ratios of orange and blue to green 1.04 and 0.88, and level 0.7: assumed, after Galileo's colours. Published "
        "spectra of the trailing side have 0.05 less blue than these plains with some dark matter. The ends are a "
        "guess that follows the downturn to the ultraviolet (Trumbo et al. 2020, AJ 160, 282)",
    ),
    "EUROPA_DARK": _make_coloured(
        "Dark matter of Europa",
        0.17,
        (0.42, 0.62, 1.25, 1.38),
        "Level: the darkest spots have 0.17 at 560 nm and 5° phase and are redder than dark ground of Ganymede "
        "(Helfenstein et al. 1998, Icarus 135, 41). One dark and red end member mixes with plains everywhere (Clark et "
        "al. 1998, Icarus 135, 95). Ratios of orange and blue to green 1.25 and 0.62: assumed, good to 0.1; the "
        "ends are a guess",
    ),
    "SULPHATE_SALTS": _make_coloured(
        "Hydrated sulphates",
        0.8,
        (0.96, 0.98, 1.01, 1.01),
        "Hydrates of magnesium and sodium sulphate have their bands above 1 µm (McCord et al. 1998, Science 280, 1242) "
        "and are white in the visible; ratios assumed. Level: a guess",
    ),
    "ACID_HYDRATE": _make_coloured(
        "Sulphuric-acid hydrate",
        0.75,
        (1.0, 1.0, 1.0, 1.0),
        "Colourless in the visible: the brown of Europa's trailing side is from sulphur (Carlson et al. 1999, Science "
        "286, 97). Level: a guess",
    ),
    "SULPHUR": _make_coloured(
        "Sulphur from radiolysis",
        0.5,
        (0.35, 0.6, 1.2, 1.25),
        "Chains and rings of sulphur in the acid hydrate (Carlson et al. 1999, Science 286, 97); ratios of orange and "
        "blue to green 1.2 and 0.6 assumed, level and ends a guess",
    ),
    "IRRADIATED_SALT": _make_with_band(
        "Irradiated table salt, laboratory",
        0.8,
        0.38,
        460.0,
        80.0,
        "Sodium chloride with colour centres, F band at 460 nm (Cerubini et al. 2022); its depth, which leaves "
        "about 0.7 of the green in the blue, and its width of 80 nm are assumed. Level: a guess",
    ),
    "EUROPA_SALT": _make_with_band(
        "Irradiated salt of Europa",
        0.7,
        0.06,
        450.0,
        80.0,
        "The band near 450 nm of chaos on the leading side (Trumbo et al. 2019, Science Advances 5, eaaw7123); depth "
        "and width assumed. Level: a guess, that of the plains",
    ),
    "THOLIN": _make_coloured(
        "Red organics (tholin)",
        0.15,
        (0.3, 0.5, 1.5, 2.0),
        "Reddest of the laboratory's organics from ices and gases (Cruikshank et al. 2005, Adv. Space Res. 36, 178, "
        "show that they colour many bodies); ratios of orange and blue to green 1.5 and 0.5 assumed, level and "
        "ends a guess. Not found on Europa or Enceladus",
    ),
}
