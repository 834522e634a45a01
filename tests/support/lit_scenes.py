"""Descriptions of light for scenes of tests."""

from __future__ import annotations

NIGHT = {"sun_azimuth_deg": 180.0, "sun_elevation_deg": -30.0}
SATURN = {
    "planet": True,
    "planet_angular_diameter_deg": 29.33,
    "planet_flattening": 0.098,
    "latitude_deg": -20.0,
    "planet_elevation_deg": 50.0,
    "planet_azimuth_deg": 20.0,
    "planet_albedo": 0.499,
    "planet_phase_law": "SATURN",
    "sun_irradiance_wm2": 14.82,
}
JUPITER = {
    "planet": True,
    "planet_angular_diameter_deg": 12.23,
    "planet_flattening": 0.065,
    "latitude_deg": 0.0,
    "planet_elevation_deg": 80.0,
    "planet_azimuth_deg": 90.0,
    "planet_albedo": 0.538,
    "planet_phase_law": "JUPITER",
    "sun_irradiance_wm2": 50.27,
}
