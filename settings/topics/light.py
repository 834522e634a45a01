"""The Sun, the planet and the stars."""

from __future__ import annotations

from typing import Literal

from .declaration import (
    ADVANCED,
    TOP,
    Section,
    Table,
    choice,
    degrees,
    fraction,
    metres,
    number,
    tables,
    text,
    tick,
)
from .ground import MAP
from .relevance import chosen, ticked

DATED = ~chosen("directions_from", "ANGLES")
PLANET = Section("planet", "Planet", "The planet in the sky and its light", switch="planet")
STARS = Section("stars", "Stars", "Stars in the sky, which do not light the ground", switch="stars")
LAMPS = Section("lamps", "Lamps", "Lamps at the cameras or at places of their own, by night and in shadow")
BALANCE = Section("balance", "Light at Evaluation", "Brightness of the light; changes need no new render")


#: Sub-panel of an entry of the list of lamps.
LAMP_PLACE = Section("lamp_place", "Position and Aim", "Place of the lamp and the direction in which it shines")
SPOT = chosen("kind", "SPOT")


class Lamp(Table):
    """An entry of ``light.lamps``."""

    __slots__ = ()
    kind: Literal["POINT", "SPOT", "AREA", "IES"] = choice(
        "Kind", "SPOT", "How the lamp spreads its light", "light",
        ("POINT", "Point", "A sphere that shines evenly in all directions, as a bare bulb"),
        ("SPOT", "Spot", "A cone of even light with a soft edge, as a headlight"),
        ("AREA", "Area", "A square that shines to one side by Lambert's law, as an LED panel"),
        ("IES", "IES File", "The measured intensity in the scene's IES file, scaled to the power"))
    power_w: float = number(
        "Power (W)", 20.0, 0.0, 1.0e5, (0.0, 100.0), "Electrical power of the lamp", "light", "W")
    efficiency: float = fraction(
        "Efficiency", 0.3, "Share of the power that leaves the lamp as light from 400 to 700 nm: about 0.3 for a white "
        "LED, 0.05 for a halogen bulb. 1 if the power is that of the light", "light")
    temperature_k: float = number(
        "Colour (K)", 5000.0, 500.0, 5.0e4, (2000.0, 1.0e4), "Colour temperature. It sets the balance of R, G and B as "
        "for the Sun", "light", "K", precision=0)
    size_m: float = metres(
        "Size", 0.05, 1.0e-4, 10.0, (0.005, 0.5), "Diameter of the shining sphere, or side of the square. It sets the "
        "softness of shadows", "light")
    cone_deg: float = degrees(
        "Cone", 60.0, 1.0, 179.0, "Full angle of the cone of a spot", "light", (5.0, 120.0), shown=SPOT)
    blend: float = fraction(
        "Soft Edge", 0.3, "Share of the cone in which a spot fades toward its edge; 0 for a sharp edge", "light",
        shown=SPOT)
    place: Literal["CAMERA", "SITE"] = choice(
        "Place", "CAMERA", "From where the position is measured", "light",
        ("CAMERA", "Camera", "Right of, before and above the left camera, with which the lamp turns and tilts"),
        ("SITE", "Site", "East, north and up from the origin of the site; the lamp stays there"),
        section=LAMP_PLACE)
    x_m: float = metres(
        "Right or East", 0.0, -1.0e4, 1.0e4, (-10.0, 10.0), "Distance right of the left camera, or east of the origin",
        "light", section=LAMP_PLACE)
    y_m: float = metres(
        "Ahead or North", 0.0, -1.0e4, 1.0e4, (-10.0, 10.0), "Distance before the left camera, or north of the origin",
        "light", section=LAMP_PLACE)
    z_m: float = metres(
        "Up", 0.1, -1.0e4, 1.0e4, (-2.0, 10.0), "Distance above the left camera, or above height zero of the site",
        "light", section=LAMP_PLACE)
    azimuth_deg: float = degrees(
        "Aim, Azimuth", 0.0, -360.0, 360.0, "Direction in which the lamp shines: clockwise from straight ahead, or "
        "from north over east", "light", (-180.0, 180.0), section=LAMP_PLACE)
    elevation_deg: float = degrees(
        "Aim, Elevation", 0.0, -90.0, 90.0, "Angle by which the lamp shines above straight ahead, or above the horizon",
        "light", section=LAMP_PLACE)


class LightSettings(Table, label="Light"):
    """The Sun, the planet and lamps, which are the only light on the ground."""

    __slots__ = ()
    directions_from: Literal["ANGLES", "DATE", "KERNELS"] = choice(
        "Sky Positions", "ANGLES", "Source of the positions of the Sun and the planet", "light",
        ("ANGLES", "Angles", "The angles below"),
        ("DATE", "Date", "Computed from body, date and site by orbital elements, within 0.25° from 2000 to 2060"),
        ("KERNELS", "SPICE Kernels", "Computed exactly from body, date and site. Needs SPICE kernels and SpiceyPy"),
        section=TOP)
    body: str = text(
        "Moon's Name", "ENCELADUS", "Moon of the site: ENCELADUS or EUROPA. SPICE kernels allow others", "light",
        "name", shown=DATED)
    parent: str = text(
        "Planet's Name", "SATURN", "Planet that the moon orbits, by its name in the kernels", "light", "name",
        section=ADVANCED, shown=chosen("directions_from", "KERNELS"))
    date_utc: str = text(
        "Date (UTC)", "2038-06-01T12:00:00", "Date and time of the scene, such as 2038-06-01T12:00:00", "light", "name",
        shown=DATED)
    latitude_deg: float = degrees(
        "Latitude", -80.0, -90.0, 90.0, "Planetocentric latitude of the site. It sets the elevation of the poles; a "
        "Sun given by angles does not depend on it", "light", active=DATED | ticked("planet") | ticked("stars"))
    longitude_deg: float = degrees(
        "Longitude", 0.0, -360.0, 360.0,
        "East longitude of the site; at a pole, north is along this meridian. The planet is above longitude "
        "-4 on Enceladus and -1.5 on Europa", "light", shown=DATED)
    place: Literal["SITE", "STATED"] = choice(
        "Place of the Sky", "SITE",
        "Place for which the sky is computed from a date, if the site of a height map is stated by coordinates",
        "light",
        ("SITE", "Site of the Map", "The site of the height map, with north as on its map; Latitude and Longitude "
         "have no effect"),
        ("STATED", "Stated Place", "The place at Latitude and Longitude; its north is the map's up"),
        shown=DATED & MAP & ~chosen("source.site", "OFFSET"), since="0.4")
    kernels: str = text(
        "Kernels", "", "A meta-kernel, or a folder from which all kernels are loaded", "light", "read",
        subtype="FILE_PATH", shown=chosen("directions_from", "KERNELS"))
    sun_irradiance_wm2: float = number(
        "Sun Irradiance (W/m²)", 14.82, 0.0, 1.0e5, (0.0, 100.0), "Solar irradiance of a surface that faces the Sun. "
        "Over all wavelengths: 14.82 at Saturn, 50.26 at Jupiter (1361 W/m² / distance² in au)", "light", "W/m²",
        section=ADVANCED, shown=~DATED)
    sun_angular_diameter_deg: float = degrees(
        "Sun Diameter", 0.0556, 0.0, 90.0, "Apparent diameter of the Sun: 0.0556 at Saturn, 0.1024 at Jupiter. It "
        "sets the softness of shadows", "light", (0.0, 1.0), 4, section=ADVANCED, shown=~DATED)
    irradiance_band: Literal["BOLOMETRIC", "CAMERA"] = choice(
        "Irradiance Band", "BOLOMETRIC", "Wavelengths that the irradiance includes. The camera response uses the part "
        "in the band of the camera", "response",
        ("BOLOMETRIC", "All Wavelengths", "The solar constant, scaled to the distance"),
        ("CAMERA", "Camera Band", "Only the wavelengths that the camera detects"),
        section=BALANCE)
    sun_scale: float = number(
        "Sun Factor", 1.0, 0.0, 1.0e6, (0.0, 10.0), "Factor on the Sun's light when images are evaluated", "response",
        section=BALANCE)
    planet_scale: float = number(
        "Planet Factor", 1.0, 0.0, 1.0e6, (0.0, 10.0), "Factor on the planet's light when images are evaluated",
        "response", section=BALANCE, active=ticked("planet"))
    sun_temperature_k: float = number(
        "Sun Temperature (K)", 5772.0, 500.0, 5.0e4, (3000.0, 1.0e4), "Colour temperature of the Sun. It sets the "
        "share of the camera's band and the balance of R, G and B, which are equal at 5772", "light", "K", precision=0,
        section=ADVANCED)
    sun_elevation_deg: float = degrees(
        "Sun Elevation", 20.0, -90.0, 90.0, "Angle of the Sun's centre above the horizon; night below 0", "light",
        section=TOP, shown=~DATED)
    sun_azimuth_deg: float = degrees(
        "Sun Azimuth", 60.0, -360.0, 360.0, "Direction of the Sun from north (+Y) over east (+X)", "light", section=TOP,
        shown=~DATED)
    sun_distance_m: float = metres(
        "Sun Distance", 0.0, 0.0, 1.0e4, (0.0, 10.0), "Distance from the origin of a laboratory lamp that replaces "
        "the Sun: a sphere with the Sun's angular diameter and irradiance at the origin. 0 for the real Sun", "light",
        zero="real Sun", section=ADVANCED, since="0.3")
    planet: bool = tick(
        "Planet", False, "Show the planet that the moon orbits in the sky, lit by the Sun, and light the ground by it",
        "light", section=PLANET)
    planet_elevation_deg: float = degrees(
        "Planet Elevation", 10.0, -90.0, 90.0, "Angle of the planet's centre above the horizon. It gives no light if "
        "its whole disc is below the horizon", "light", section=PLANET, shown=~DATED, active=ticked("planet"))
    planet_azimuth_deg: float = degrees(
        "Planet Azimuth", 0.0, -360.0, 360.0, "Direction of the planet from north (+Y) over east (+X)", "light",
        section=PLANET, shown=~DATED, active=ticked("planet"))
    planet_angular_diameter_deg: float = degrees(
        "Planet Diameter", 29.33, 0.0, 120.0, "Apparent diameter of the equator: 29.33 for Saturn from Enceladus, "
        "12.23 for Jupiter from Europa", "light", (0.0, 40.0), section=PLANET, shown=~DATED, active=ticked("planet"))
    planet_flattening: float = fraction(
        "Planet Flattening", 0.0, "1 - polar radius / equatorial radius: 0.098 for Saturn, 0.065 for Jupiter", "light",
        high=0.5, section=PLANET, shown=~DATED, active=ticked("planet"))
    planet_albedo: float = fraction(
        "Planet Albedo", 0.499, "Geometric albedo: brightness at full phase relative to a white disc of the same size",
        "light", high=2.0, section=PLANET, active=ticked("planet"))
    planet_phase_law: Literal["LAMBERT", "SATURN", "JUPITER"] = choice(
        "Planet Phase Law", "LAMBERT", "Law of the planet's brightness against its phase", "light",
        ("LAMBERT", "Lambert", "A matt sphere"),
        ("SATURN", "Saturn", "Published curve of Saturn's globe (Mallama and Hilton 2018)"),
        ("JUPITER", "Jupiter", "Published curve of Jupiter (Mallama and Hilton 2018)"),
        section=PLANET, active=ticked("planet"))
    planet_least: float = number(
        "Minimum Planet Light", 1.0e-4, 0.0, 1.0, (0.0, 0.01), "Ratio of the planet's light to the Sun's below which "
        "the planet does not light the ground by day: camera noise would hide it. 0 to always light it", "light",
        precision=6, section=PLANET, active=ticked("planet"))
    planet_rings: bool = tick(
        "Planet Rings", False, "Saturn's rings A, B and C with the Cassini Division, and their shadow, which takes up "
        "to 20 % of the planet's light. Enceladus sees them edge-on; raise Planet Elevation to open them", "light",
        section=PLANET, active=ticked("planet"))
    planet_face: Literal["PLAIN", "SATURN", "JUPITER"] = choice(
        "Planet Face", "PLAIN", "Pattern of the planet's clouds. It changes the planet in the images and the colour "
        "of its light, not how much light it gives", "light",
        ("PLAIN", "Plain", "A matt globe without a pattern"),
        ("SATURN", "Saturn", "Saturn's bands, limb darkening and colour"),
        ("JUPITER", "Jupiter", "Jupiter's belts and zones, Great Red Spot, limb darkening and colour"),
        section=PLANET, active=ticked("planet"), since="0.3")
    planet_spot_longitude_deg: float = degrees(
        "Red Spot Longitude", 0.0, -360.0, 360.0, "Longitude of Jupiter's Great Red Spot, east of the meridian that "
        "faces the moon", "light", section=PLANET, active=ticked("planet"), since="0.3")
    moons: bool = tick(
        "Other Moons", False, "Show the planet's other large moons at the date: from Enceladus Mimas, Tethys, Dione, "
        "Rhea and Titan, from Europa Io, Ganymede and Callisto. They do not light the ground", "light",
        section=PLANET, shown=DATED, active=ticked("planet"), since="0.4")
    lamps: list[Lamp] = tables(
        "Lamps", Lamp, "Lamps beside the Sun, one table per lamp, at most eight", "light", section=LAMPS, since="0.4")
    ies_file: str = text(
        "IES File", "", "Measured intensity by direction (LM-63) of IES lamps. // is the folder of the "
        ".blend file", "light", "read", subtype="FILE_PATH", section=LAMPS, active=ticked("lamps"), since="0.4")
    lamp_scales: str = text(
        "Lamp Factors", "", "Factors on the light of the lamps when images are evaluated, in the order of the lamps, "
        "such as 1, 0.5. If it is empty, all factors are 1", "response", "factors", section=BALANCE,
        active=ticked("lamps"), since="0.4")
    stars: bool = tick(
        "Stars", False, "Show stars in the sky at their true brightness. They do not light the ground", "light",
        section=STARS)
    stars_faintest_mag: float = number(
        "Faintest Star (mag)", 2.5, -2.0, 8.0, (0.0, 6.5), "Faintest V magnitude of the stars. Stars down to 2.5 are "
        "real; fainter ones are random, in their true number", "light", "mag", precision=1, section=STARS,
        active=ticked("stars"))


class VeilSettings(Table, label="Veil", inside="light", turned_on_by="optical_depth", since="0.3"):
    """Falling grains or vapour before the ground, as beneath a plume. Rendered pairs have it, the window does not."""

    __slots__ = ()
    optical_depth: float = number(
        "Optical Depth", 0.0, 0.0, 20.0, (0.0, 2.0),
        "Optical depth straight down from the top of the veil to the level of the site; 0 for no veil. The "
        "share exp(-depth) of the light is neither scattered nor absorbed", "sampling", precision=4,
        zero="off")
    top_m: float = metres(
        "Top Height", 20.0, 0.1, 1.0e4, (1.0, 100.0), "Height of the top of the veil above the level of the site. The "
        "veil is equally dense at all heights below it", "sampling")
    width_m: float = metres(
        "Width", 200.0, 1.0, 1.0e5, (10.0, 1000.0), "Side of the square around the origin of the site that the veil "
        "fills",
        "sampling")
    grain_albedo: float = fraction(
        "Grain Albedo", 1.0, "Share of the light on a grain that the grain scatters. Ice grains of a plume absorb less "
        "than a millionth", "sampling")
    asymmetry: float = number(
        "Asymmetry", 0.85, -0.99, 0.99, (0.0, 0.95), "Mean cosine of the angle of scattering, of Henyey and "
        "Greenstein's phase function. 0.85 for ice spheres of 3.1 µm (Mie), the median of Enceladus' plume (Ingersoll "
        "and Ewald 2011); 0 is close to vapour", "sampling")
