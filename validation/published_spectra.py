"""Published spectra, at the few wavelengths that comparisons use.

Read from the tables of the program TrueColorTools (github.com/Askaniy/TrueColorTools, ``spectra/``), not from the
papers. None of them was used to make a material or a preset.
"""

from __future__ import annotations

import numpy as np

#: Wavelengths in nm of the reflectances below.
WAVELENGTHS_NM = (400.0, 460.0, 470.0, 550.0, 620.0, 700.0)
GREEN_INDEX = WAVELENGTHS_NM.index(550.0)

#: Europa's trailing hemisphere: albedo by Spencer 1999, from Madden and Kaltenegger 2018, arXiv 1807.11442; and
#: reflectance relative to about 700 nm, from the USGS's archive of planetary spectra.
EUROPA_TRAILING = np.array(
    [[0.4506, 0.5094, 0.5278, 0.6110, 0.6307, 0.6394], [0.4674, 0.6731, 0.7026, 0.8459, 0.9425, 1.0066]]
)
EUROPA_SOURCE = (
    "Spencer 1999 in Madden and Kaltenegger 2018, arXiv 1807.11442, and the USGS' archive of planetary "
    "spectra; the mean and half the difference of both"
)

#: Enceladus by Cassini's VIMS, in Madden and Kaltenegger 2018: means over 20 nm.
ENCELADUS = np.array([0.8788, 0.8996, 0.9028, 0.9070, 0.8868, 0.8725])
ENCELADUS_SOURCE = "Cassini's VIMS in Madden and Kaltenegger 2018, arXiv 1807.11442; the error is a guess"

#: Clean snow of grains of this radius in metres, by the model of Khuller et al. 2021, J. Geophys. Res. Planets 126.
SNOW = {
    100e-6: (0.99829, 0.9962, 0.99546, 0.98555, 0.97383, 0.95442),
    500e-6: (0.99619, 0.99152, 0.98984, 0.96802, 0.9424, 0.90242),
    2500e-6: (0.98837, 0.97454, 0.96951, 0.90771, 0.84013, 0.74453),
}
SNOW_SOURCE = "Khuller et al. 2021, doi 10.1029/2021JE006910: another program, with the same absorption of ice"


def read_europa_over_green(wavelength_nm: float) -> tuple[float, float]:
    """Read the reflectance of Europa's trailing hemisphere, divided by its reflectance at 550 nm: the mean and half the
    difference of both spectra."""
    column = WAVELENGTHS_NM.index(wavelength_nm)
    one, other = EUROPA_TRAILING[:, column] / EUROPA_TRAILING[:, GREEN_INDEX]
    return float((one + other) / 2), float(abs(one - other) / 2)
