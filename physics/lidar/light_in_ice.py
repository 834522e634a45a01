"""Light of a laser that enters snow or ice and leaves it late: delay, spread, and the range bias that follows.

Light diffuses once it has gone a transport mean free path l*. A pulse that enters along the normal acts as a source at
depth l*, and light is lost beyond an extrapolated boundary (2/3) l* above the surface. The path s inside then has the
inverse Gaussian law of a first passage from z = (5/3) l* with the diffusivity D = l*/3, weakened by exp(-μa s):

    z (4πD)^(-1/2) s^(-3/2) exp(-z²/4Ds - μa s)

Photon walks agree (``python benchmarks light_in_ice``). Where ice absorbs strongly, light returns after one backward
scattering, and paths are exponential. The receiver sees only light that leaves toward it, about along the beam. The
paths of this light are longer than the paths of all light, which ``ALONG_BEAM`` allows for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...settings.topics.surfaces import SurfaceSettings
from ...support.arrays import Array, Numbers
from ...support.errors import IcyMoonError
from ..light.photons import LIGHT_M_S
from ..surfaces.spectra import ABSORPTION_ENHANCEMENT, BUBBLE_ASYMMETRY, ICE_KG_M3, SNOW_ASYMMETRY
from .ice_constants import group_index, laser_absorption_1_m, refractive_index

#: Depth z over l* for all light that leaves: source depth plus extrapolation length.
ALL_EXITS = 5.0 / 3.0
#: Depth z over l* for light that leaves along the beam. It is fitted to photon walks, and gives their mean paths and
#: quartiles within 5 % at μa l* from 0.01 to 0.1. The limit without absorption is (4/3) K(1)²/R(1, 1) = 2 by asymptotic
#: radiative transfer (escape function and reflectance as in ``surfaces.snow``).
ALONG_BEAM = 11.0 / 6.0
#: μa l* above which a single backward scattering is nearer to photon walks than diffusion.
STRONG_ABSORPTION = 0.5
#: Factor on the mean path of a single backward scattering, over z/l*, for light that is scattered again: fitted to
#: photon walks with g = 0.79 and 0.845.
_SCATTERED_AGAIN = 8.0 / 11.0
#: FWHM of a Gaussian over its standard deviation.
FWHM = 2.0 * math.sqrt(2.0 * math.log(2.0))
#: Number of nodes of a law in the logarithm of the path, and number of nodes per standard deviation of the pulse.
_LOG_NODES, _NODES_A_DEVIATION = 500, 4.0
#: Number of cells of a waveform per standard deviation of the pulse, and standard deviations before the surface at
#: which the waveform begins. Light between two cells widens the waveform; with 64 cells the rising edge is then up to 1
#: % of its bias early.
_CELLS_A_DEVIATION, _DEVIATIONS = 64.0, 5.0
_MAX_CELLS = 400_000


@dataclass(frozen=True)
class Medium:
    """Optical properties of snow or ice.

    ``transport_m`` is the transport mean free path l* in metres (0: light does not enter), ``absorption_1_m`` the
    absorption μa along the path in 1/m, and ``asymmetry`` the mean cosine g of a scattering. ``delay_index`` is the
    optical path over the path, and ``surface_index`` the refractive index behind a smooth surface (1: grains without
    one). Raises IcyMoonError for impossible values.
    """

    title: str
    transport_m: float
    absorption_1_m: float
    asymmetry: float
    delay_index: float = 1.0
    surface_index: float = 1.0

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("transport mean free path", self.transport_m, 0.0, 1e4),
            ("absorption in 1/m", self.absorption_1_m, 0.0, 1e9),
            ("asymmetry of scattering", self.asymmetry, -0.999, 0.999),
            ("delay index", self.delay_index, 1.0, 5.0),
            ("surface index", self.surface_index, 1.0, 5.0),
        ):
            if not low <= value <= high:
                raise IcyMoonError(f"{self.title}: the {name} is {value:g}; give {low:g} to {high:g}.")

    @property
    def absorbed(self) -> float:
        """Absorption over a transport mean free path, μa l*."""
        return self.absorption_1_m * self.transport_m

    @property
    def diffusivity_m(self) -> float:
        """Diffusivity D = l*/3 in metres: the variance along an axis over twice the path."""
        return self.transport_m / 3.0


def check_snow(grain_radius_m: float | None, density_kg_m3: float | None) -> None:
    """Raise IcyMoonError for a radius of grains or a density that no snow has; None means that it is not stated."""
    if grain_radius_m is not None and not 0.0 < grain_radius_m <= 0.1:
        raise IcyMoonError(f"The grain radius is {grain_radius_m:g} m; give more than 0 and at most 0.1 m.")
    if density_kg_m3 is not None and not 0.0 < density_kg_m3 <= ICE_KG_M3:
        raise IcyMoonError(
            f"The density of snow is {density_kg_m3:g} kg/m³; give more than 0 and at most {ICE_KG_M3:g}, as ice has."
        )


def make_snow(
    grain_radius_m: float, density_kg_m3: float, wavelength_nm: float, asymmetry: float = SNOW_ASYMMETRY
) -> Medium:
    """Make the medium of snow with grains of an optical radius r.

    Grains cover twice their cross-section (geometric optics with diffraction), so that l* = 2 ρi r / (3 ρ (1 - g)). A
    share φ = ρ/ρi of the volume is ice, in which paths are B = 1.6 times longer (Libois et al. 2014), hence μa = B φ α.
    Light is slower by the same paths: the delay index is 1 - φ + B φ n, by the energy that ice holds in even light. The
    index is derived, not measured. Raises IcyMoonError for a radius or density that no snow has.
    """
    check_snow(grain_radius_m, density_kg_m3)
    share = density_kg_m3 / ICE_KG_M3
    return Medium(
        f"snow of {grain_radius_m * 1e6:g} µm and {density_kg_m3:g} kg/m³",
        2.0 * grain_radius_m / (3.0 * share * (1.0 - asymmetry)),
        ABSORPTION_ENHANCEMENT * share * laser_absorption_1_m(wavelength_nm),
        asymmetry,
        1.0 - share + ABSORPTION_ENHANCEMENT * share * group_index(wavelength_nm),
    )


def make_bubbly_ice(
    bubble_radius_m: float, bubble_share: float, wavelength_nm: float, smooth_surface: bool = False
) -> Medium:
    """Make the medium of ice with air bubbles of radius a and volume share f: l* = 4a / (3 f (1 - g)), as for the
    surfaces' colours.

    With ``smooth_surface`` the surface reflects leaving light back by Fresnel's formulas, which lengthens paths.
    Weathered ice has frost on it instead. Raises IcyMoonError for a radius or share that no ice has.
    """
    if not 0.0 < bubble_radius_m <= 1.0:
        raise IcyMoonError(f"The bubble radius is {bubble_radius_m:g} m; give more than 0 and at most 1 m.")
    if not 0.0 < bubble_share < 0.7:
        raise IcyMoonError(f"The share of bubbles is {bubble_share:g}; give more than 0 and less than 0.7.")
    return Medium(
        f"ice with {bubble_share:.2g} of bubbles of {bubble_radius_m * 1e6:g} µm",
        4.0 * bubble_radius_m / (3.0 * bubble_share * (1.0 - BUBBLE_ASYMMETRY)),
        (1.0 - bubble_share) * laser_absorption_1_m(wavelength_nm),
        BUBBLE_ASYMMETRY,
        (1.0 - bubble_share) * group_index(wavelength_nm) + bubble_share,
        refractive_index(wavelength_nm) if smooth_surface else 1.0,
    )


def find_medium(surface: SurfaceSettings, density_kg_m3: float, wavelength_nm: float) -> Medium | None:
    """Make the medium of a surface's settings: its bubbles, or the grains of its snow with a density in kg/m³. None
    where the settings state neither, so that range is measured to the surface.
    """
    if surface.model == "PRINCIPLED" and surface.bubble_share > 0.0:
        share = min(float(surface.bubble_share), 0.69)
        return make_bubbly_ice(float(surface.bubble_radius_m), share, wavelength_nm)
    if surface.ice_colour == "SNOW":
        return make_snow(float(surface.snow_grain_m), density_kg_m3, wavelength_nm)
    return None


def extrapolation_factor(surface_index: float) -> float:
    """Compute the factor A on the extrapolation length by light that a smooth surface reflects back; 1 without a
    surface.

    A = (1 + 3 R₂)/(1 - 2 R₁), with the moments R₁ = ∫ R μ dμ and R₂ = ∫ R μ² dμ of Fresnel's reflectance (Contini et
    al. 1997, Applied Optics 36, 4587).
    """
    if surface_index == 1.0:
        return 1.0
    # Below the critical cosine all light is reflected; above it a square removes the root in Fresnel's formulas.
    critical = math.sqrt(1.0 - 1.0 / surface_index**2)
    x, weight = np.polynomial.legendre.leggauss(32)
    x = (x + 1.0) / 2.0
    cosine, weight = critical + (1.0 - critical) * x**2, (1.0 - critical) * x * weight
    outside = np.sqrt(np.maximum(1.0 - surface_index**2 * (1.0 - cosine**2), 0.0))
    across = (surface_index * cosine - outside) / (surface_index * cosine + outside)
    along = (cosine - surface_index * outside) / (cosine + surface_index * outside)
    light = weight * (across**2 + along**2) / 2.0
    first = critical**2 / 2.0 + float((light * cosine).sum())
    second = critical**3 / 3.0 + float((light * cosine**2).sum())
    return (1.0 + 3.0 * second) / (1.0 - 2.0 * first)


def start_depth_m(medium: Medium, depth: float = ALONG_BEAM) -> float:
    """Compute the depth z in metres from which the law's first passage starts; ``depth`` is z/l* without a smooth
    surface.

    Under a smooth surface z is (1 + 2A/3) l* for light in all directions. Mean paths are then 3 to 16 % longer than in
    photon walks with μa l* of 0.01 and 0.03.
    """
    if medium.surface_index > 1.0:
        depth = 1.0 + 2.0 / 3.0 * extrapolation_factor(medium.surface_index)
    return medium.transport_m * depth


def backscatter_1_m(medium: Medium) -> float:
    """Compute the coefficient of backward scattering in 1/m, by Henyey and Greenstein's phase function."""
    g = medium.asymmetry
    back = 0.5 if abs(g) < 1e-6 else (1.0 - g) / (2.0 * g) * ((1.0 + g) / math.sqrt(1.0 + g * g) - 1.0)
    return back / (medium.transport_m * (1.0 - g))


def plane_albedo(medium: Medium) -> float:
    """Compute the share of a pulse along the normal that leaves again in any direction: exp(-(z/l*) √(3 μa l*))."""
    z = start_depth_m(medium, ALL_EXITS)
    return math.exp(-z * math.sqrt(medium.absorption_1_m / medium.diffusivity_m)) if z else 1.0


def mean_path_m(medium: Medium, depth: float = ALONG_BEAM) -> float:
    """Compute the mean path inside in metres: z / (2 √(D μa)), infinite without absorption.

    Where absorption is strong it is 1/(μa + μb), by Gordon's quasi-single scattering (1973, Applied Optics 12, 2803),
    times (8/11) z/l* for light that is scattered again.
    """
    if medium.transport_m == 0.0:
        return 0.0
    if medium.absorbed > STRONG_ABSORPTION:
        return _SCATTERED_AGAIN * depth / (medium.absorption_1_m + backscatter_1_m(medium))
    if medium.absorption_1_m == 0.0:
        return math.inf
    return start_depth_m(medium, depth) / (2.0 * math.sqrt(medium.diffusivity_m * medium.absorption_1_m))


def path_density_1_m(medium: Medium, path_m: Numbers, depth: float = ALONG_BEAM) -> Array:
    """Compute the density in 1/m of the path s inside for light that leaves; its integral over all paths is 1."""
    s = np.asarray(path_m, np.float64)
    if medium.absorbed > STRONG_ABSORPTION:
        mean = mean_path_m(medium, depth)
        return np.asarray(np.exp(-s / mean) / mean)
    z, d, lost = start_depth_m(medium, depth), medium.diffusivity_m, medium.absorption_1_m
    safe = np.maximum(s, 1e-6 * z)
    # The exponents of the law and of its normalisation make a square, which is exact where both are large.
    exponent = -((z - 2.0 * math.sqrt(d * lost) * safe) ** 2) / (4.0 * d * safe)
    return np.where(s > 0.0, z / math.sqrt(4.0 * math.pi * d) * safe**-1.5 * np.exp(exponent), 0.0)


def draw_paths_m(medium: Medium, count: int, random: np.random.Generator, depth: float = ALONG_BEAM) -> Array:
    """Draw the paths inside (count,) in metres, one for each photon that leaves."""
    if medium.transport_m == 0.0:
        return np.zeros(count)
    mean = mean_path_m(medium, depth)
    if medium.absorbed > STRONG_ABSORPTION:
        return random.exponential(mean, count)
    z, d = start_depth_m(medium, depth), medium.diffusivity_m
    if math.isinf(mean):
        return z * z / (2.0 * d * np.maximum(random.standard_normal(count) ** 2, 1e-300))
    return random.wald(mean, z * z / (2.0 * d), count)


def share_in_field(medium: Medium, path_m: Numbers, field_radius_m: float, spot_radius_m: float = 0.0) -> Array:
    """Compute the share of the light of a path that leaves within the receiver's field, a disc about the beam's centre.

    Light of path s has the variance 2Ds on each axis; a beam of 1/e² radius w adds w²/4.
    """
    s = np.asarray(path_m, np.float64)
    if math.isinf(field_radius_m):
        return np.ones_like(s)
    variance = 2.0 * medium.diffusivity_m * s + spot_radius_m**2 / 4.0
    return np.asarray(-np.expm1(-(field_radius_m**2) / (2.0 * np.maximum(variance, 1e-300))))


def energy_in_field(medium: Medium, field_radius_m: float, depth: float = ALONG_BEAM) -> float:
    """Compute the share of all light that leaves within a disc of radius ρ about a narrow beam: 1 - (z/q) exp(-(q - z)
    √(μa/D)) with q² = z² + ρ². It is the integral of ``share_in_field`` over the inverse Gaussian law.
    """
    z = start_depth_m(medium, depth)
    if z == 0.0 or math.isinf(field_radius_m):
        return 1.0
    q = math.hypot(z, field_radius_m)
    return 1.0 - z / q * math.exp(-(q - z) * math.sqrt(medium.absorption_1_m / medium.diffusivity_m))


@dataclass(frozen=True)
class Receiver:
    """A pulse and a receiver, which measure the delays.

    ``pulse_fwhm_s`` is the full width of the Gaussian pulse at half its height, and ``gate_m`` the range behind the
    surface to which the centroid counts. ``field_radius_m`` is the radius of the field of view on the ground, and
    ``spot_radius_m`` the 1/e² radius of the beam there. ``surface_share`` is the share of the return that the surface
    itself reflects without delay. Raises IcyMoonError for impossible values.
    """

    pulse_fwhm_s: float
    gate_m: float = 1.0
    field_radius_m: float = math.inf
    spot_radius_m: float = 0.0
    surface_share: float = 0.0

    def __post_init__(self) -> None:
        for name, value, unit in (("pulse", self.pulse_fwhm_s, "s"), ("gate", self.gate_m, "m")):
            if not 0.0 < value < math.inf:
                raise IcyMoonError(f"The {name} is {value:g} {unit} long; give more than 0.")
        if not self.field_radius_m > 0.0 or not 0.0 <= self.spot_radius_m < math.inf:
            raise IcyMoonError("The receiver's field or the beam has a negative radius; give more than 0 m.")
        if not 0.0 <= self.surface_share <= 1.0:
            raise IcyMoonError(f"The surface's share is {self.surface_share:g}; give 0 to 1.")
        if self.gate_m / self.deviation_m * _CELLS_A_DEVIATION > _MAX_CELLS:
            raise IcyMoonError(
                f"A gate of {self.gate_m:g} m is too long for a pulse of {self.pulse_fwhm_s:g} s; shorten the gate."
            )

    @property
    def deviation_m(self) -> float:
        """Standard deviation of the pulse, as range in metres."""
        return self.pulse_fwhm_s / FWHM * LIGHT_M_S / 2.0


@dataclass(frozen=True)
class Waveform:
    """Received power (n,) in 1/m over the apparent range (n,) in metres behind the surface; its integral is the share
    of the light that the receiver sees within the gate."""

    range_m: Array
    power: Array


def make_waveform(medium: Medium, receiver: Receiver, depth: float = ALONG_BEAM) -> Waveform:
    """Compute the pulse as the paths in a medium delay it. Apparent range is delay times c/2, so half the optical
    path.
    """
    deviation = receiver.deviation_m
    step = deviation / _CELLS_A_DEVIATION
    before = round(_DEVIATIONS * _CELLS_A_DEVIATION)
    count = math.ceil(receiver.gate_m / step) + 1
    delayed = np.zeros(count)
    delayed[0] = receiver.surface_share if medium.transport_m > 0.0 else 1.0
    if medium.transport_m > 0.0:
        path, mass = _split_law(medium, receiver, depth)
        place = path * medium.delay_index / 2.0 / step
        first = np.floor(place).astype(np.int64)
        inside = first < count - 1
        first, part, mass = first[inside], (place - first)[inside], (1.0 - receiver.surface_share) * mass[inside]
        # Each mass is divided between two cells, so that neither the mass nor its place is rounded.
        delayed += np.bincount(first, mass * (1.0 - part), count) + np.bincount(first + 1, mass * part, count)
    offset = np.arange(-before, before + 1) / _CELLS_A_DEVIATION
    pulse = np.exp(-(offset**2) / 2.0)
    power = np.convolve(delayed, pulse / (pulse.sum() * step))[: count + before]
    return Waveform((np.arange(len(power)) - before) * step, power)


def _split_law(medium: Medium, receiver: Receiver, depth: float) -> tuple[Array, Array]:
    """Split the law of paths at steps that are fine for both the law and the pulse. Return the paths (n,) in metres,
    and the share (n,) of the light that each stands for.
    """
    farthest = 2.0 * receiver.gate_m / medium.delay_index
    scale = min(mean_path_m(medium, depth), start_depth_m(medium, depth))
    spacing = receiver.deviation_m / _NODES_A_DEVIATION
    even = np.arange(0.0, farthest, spacing)
    edge = np.union1d(even, np.geomspace(min(1e-3 * scale, farthest / 2.0), farthest, _LOG_NODES))
    path = (edge[1:] + edge[:-1]) / 2.0
    # Simpson's rule in each part.
    density = path_density_1_m(medium, edge, depth)
    mass = (density[1:] + density[:-1] + 4.0 * path_density_1_m(medium, path, depth)) / 6.0 * np.diff(edge)
    return path, mass * share_in_field(medium, path, receiver.field_radius_m, receiver.spot_radius_m)


@dataclass(frozen=True)
class RangeBias:
    """The excess of a range in metres if the receiver times half of the peak on the rising edge, the peak, or the
    centroid in the gate. ``energy`` is the share of the light that the receiver sees in the gate.
    """

    edge_m: float
    peak_m: float
    centroid_m: float
    energy: float


@dataclass(frozen=True)
class ReturnBiases:
    """The numbers of ``RangeBias`` for each return, as arrays (n,)."""

    edge_m: Array
    peak_m: Array
    centroid_m: Array
    energy: Array


def measure_bias(medium: Medium, receiver: Receiver, depth: float = ALONG_BEAM) -> RangeBias:
    """Measure the bias of a medium, relative to a hard surface with the same pulse and the same gate."""
    wave = make_waveform(medium, receiver, depth)
    hard = make_waveform(replace(medium, transport_m=0.0), receiver)
    edge, peak, centroid = (a - b for a, b in zip(_time_waveform(wave), _time_waveform(hard), strict=True))
    step = wave.range_m[1] - wave.range_m[0]
    return RangeBias(edge, peak, centroid, float(wave.power.sum() * step))


def _time_waveform(wave: Waveform) -> tuple[float, float, float]:
    """Find the ranges in metres of the rising half, the peak and the centroid of a waveform."""
    power, step = wave.power, wave.range_m[1] - wave.range_m[0]
    top = int(np.argmax(power))
    rising = int(np.argmax(power >= power[top] / 2.0))
    low, high = (power[rising - 1], power[rising]) if rising else (0.0, power[0])
    edge = wave.range_m[rising] - step * (high - power[top] / 2.0) / (high - low)
    bend = 0.0
    if 0 < top < len(power) - 1:
        left, right = power[top - 1], power[top + 1]
        bend = 0.5 * (left - right) / (left - 2.0 * power[top] + right)
    return float(edge), float(wave.range_m[top] + bend * step), float((power * wave.range_m).sum() / power.sum())


def measure_return_biases(
    medium: Medium, receiver: Receiver, field_radius_m: Array, depth: float = ALONG_BEAM, nodes: int = 24
) -> ReturnBiases:
    """Measure the true biases (n,) of returns from one medium. ``field_radius_m`` (n,) is the radius in metres of the
    receiver's field at each return's range.

    Biases are computed at ``nodes`` radii and interpolated in the logarithm of the radius; they are exact if all radii
    are equal.
    """
    radius = np.asarray(field_radius_m, np.float64)
    if radius.size == 0:
        return ReturnBiases(*(np.zeros(radius.shape) for _ in range(4)))
    if not (radius > 0.0).all():
        raise IcyMoonError(
            "A return's field of view has no radius above 0 m; check its range and the receiver's angle."
        )
    # Beyond a thousand l* all light is seen.
    capped = np.minimum(radius, max(1e3 * medium.transport_m, 10.0 * receiver.gate_m))
    at = np.unique(np.geomspace(capped.min(), capped.max(), nodes))
    found = [measure_bias(medium, replace(receiver, field_radius_m=float(one)), depth) for one in at]
    return ReturnBiases(
        *(
            np.interp(np.log(capped), np.log(at), [getattr(each, name) for each in found])
            for name in ("edge_m", "peak_m", "centroid_m", "energy")
        )
    )
