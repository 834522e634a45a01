"""What a scene's settings state of laser light: the media that it enters, and sunlight on the detector."""

from __future__ import annotations

from ...settings.topics.scene import Settings
from ...support.labels import ROCK, TERRAIN
from .backscatter import Backscatter
from .instrument import Instrument
from .light_in_ice import Medium, check_snow, find_medium, make_snow
from .sun_background import background_photons_1_s


def find_scene_media(
    settings: Settings, wavelength_nm: float, grain_radius_m: float | None = None, density_kg_m3: float | None = None
) -> tuple[dict[int, Medium], dict[str, str]]:
    """Find the media of ground and rocks by label, and a clause for reports on each by the names "terrain" and "rocks".

    Grains and bubbles come from the settings of each surface; a grain radius in metres makes both surfaces snow. The
    default density of snow is from the excavation's settings, the only density that a scene states. Raises IcyMoonError
    for grains, densities and wavelengths outside the tables, also where no surface is snow.
    """
    check_snow(grain_radius_m, density_kg_m3)
    density = float(settings.excavation.density_kg_m3) if density_kg_m3 is None else density_kg_m3
    rock = settings.rock_surface if settings.rocks.own_surface else settings.surface
    media, words = {}, {}
    for label, name, surface in ((TERRAIN, "terrain", settings.surface), (ROCK, "rocks", rock)):
        if grain_radius_m is not None:
            medium: Medium | None = make_snow(grain_radius_m, density, wavelength_nm)
        else:
            medium = find_medium(surface, density, wavelength_nm)
        if medium is None:
            words[name] = (
                "left out, because the surface has neither grains of snow (surface.ice_colour SNOW) nor bubbles "
                "(surface.bubble_share); light returns without delay"
            )
            continue
        media[label] = medium
        words[name] = (
            f"{medium.title}, transport mean free path {medium.transport_m * 1e3:.3g} mm, absorption "
            f"{medium.absorption_1_m:.3g} 1/m"
        )
    return media, words


def find_sunlight_1_s(
    settings: Settings, instrument: Instrument, filter_nm: float, sine_of_elevation: float, law: Backscatter
) -> tuple[float, str]:
    """Compute the sunlight in photons per second on the detector from level ground without shadow. Also return a clause
    on it for reports. Sunlight is 0 for an instrument without a stated filter (``filter_nm`` 0) or field of view, and
    by night.
    """
    if not filter_nm:
        return 0.0, "left out, because the detector's file states no filter (detector.filter_nm)"
    if instrument.field_half_angle_rad >= 1.0:
        return 0.0, "left out, because the scanner's file states no field of view (lidar.field_mrad)"
    if sine_of_elevation <= 0.0:
        return 0.0, "none, because the Sun is below the horizon"
    found = background_photons_1_s(
        settings.light.sun_irradiance_wm2,
        sine_of_elevation,
        float(law.reflectance[-1]),
        instrument.wavelength_m * 1e9,
        filter_nm,
        2.0 * instrument.aperture_radius_m,
        2.0 * instrument.field_half_angle_rad,
        instrument.efficiency,
    )
    return float(found), f"{float(found):.3g} photons per second, from level ground without shadow"
