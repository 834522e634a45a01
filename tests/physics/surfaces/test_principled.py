"""The Principled surface's measured reflectance against optics, and its inverse."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.physics.surfaces import principled
from icymoon.settings.description import defaults
from icymoon.settings.topics.surfaces import SurfaceSettings


@pytest.fixture(autouse=True, scope="module", params=principled.TABLE_FILES)
def table(request):
    """Every test with the table of every Blender."""
    principled.use_table(request.param)
    yield
    principled.use_table("5.0")


def surface(**changes: Any) -> SurfaceSettings:
    return defaults().surface | {"grain_amplitude_m": 0.0, **changes}


def fresnel(index: float) -> float:
    """Hemispherical reflectance of a smooth dielectric of a refractive index, by Fresnel's equations."""
    mu = (np.arange(20000) + 0.5) / 20000
    inside = np.sqrt(1.0 - (1.0 - mu**2) / index**2)
    s = ((mu - index * inside) / (mu + index * inside)) ** 2
    p = ((inside - index * mu) / (inside + index * mu)) ** 2
    return float(np.mean((s + p) * mu))


@pytest.mark.parametrize("index", [1.1, 1.22, 1.31, 1.5, 2.0, 3.0])
def test_smooth_black_ice_reflects_as_fresnel_says(index):
    reflectance = principled.albedo_curve(surface(refractive_index=index, specular=0.5, roughness=0.0))[1][0]
    # Measured at eight emission angles to four digits, interpolated between six indices: a thousandth of the light.
    assert reflectance == pytest.approx(fresnel(index), rel=0.01, abs=0.002)


@given(
    st.floats(0, 1),
    st.floats(0, 1),
    st.floats(1, 3),
    st.floats(0, 1),
    st.floats(0, 1),
    st.floats(0, 1),
    st.floats(0, 0.1),
)
def test_base_colour_gives_the_albedo_or_the_nearest_there_is(albedo, roughness, index, specular, weight, share, bumps):
    settings = surface(
        albedo=albedo,
        roughness=roughness,
        refractive_index=index,
        specular=specular,
        subsurface_weight=weight,
        transmission=share,
        grain_amplitude_m=bumps,
    )
    base, reflectance = principled.albedo_curve(settings)
    assert np.all(np.diff(reflectance) >= -1e-12)
    assert 0.0 <= reflectance[0] <= reflectance[-1] <= 1.0
    chosen = principled.base_colour(settings, albedo)
    assert 0.0 <= chosen <= 1.0
    assert np.interp(chosen, base, reflectance) == pytest.approx(principled.real_albedo(settings), abs=1e-9)
    told = principled.advise_on_albedo(settings)
    assert bool(told) == (abs(principled.real_albedo(settings) - albedo) > 0.01 * albedo)


def test_advice_names_what_takes_the_light():
    assert principled.advise_on_albedo(surface(albedo=0.9)) == ""
    assert "transmission" in principled.advise_on_albedo(surface(albedo=0.9, transmission=0.5))
    assert "subsurface_weight" in principled.advise_on_albedo(surface(albedo=1.0, subsurface_weight=1.0))
    assert "grain_amplitude_m" in principled.advise_on_albedo(surface(albedo=1.0, grain_amplitude_m=0.05))
    assert "specular" in principled.advise_on_albedo(surface(albedo=0.01, specular=1.0))


@pytest.mark.parametrize(("index", "share"), [(1.0, 0.0), (1.31, 0.0627), (1.5, 0.0918)])
def test_even_light_is_reflected_as_tables_have_it(index, share):
    # Glass of 1.5 reflects 9.2 % (Judd 1942, J. Res. NBS 29, 329); Walsh's closed form gives 0.0627 for 1.31.
    assert principled.diffuse_fresnel_reflectance(index) == pytest.approx(share, abs=1e-4)
