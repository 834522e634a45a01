"""Statistics of made grounds and rocks beside published numbers and closed forms; renders nothing."""

from __future__ import annotations

from .comparison import Bench, Comparison, Row
from .ground_hill_rows import make_hill_rows
from .ground_relief_rows import make_relief_rows
from .ground_rock_rows import make_rock_rows

#: Seeds of the grounds. The slopes that presets state were measured at the seeds 1 to 3.
SEEDS = (4, 5, 6)

_TEXT = """\
Grounds and rocks of the presets, at seeds 4 to 6 and with `--quick` at seed 4, are compared with published numbers, \
with laws in closed form, and with what the presets state. Nothing is rendered. Published numbers were read in \
abstracts. The table is of the quick run.

* **Sizes of rocks.** The index of the power law is fitted by maximum likelihood, above the smallest size that was \
drawn, with the upper end of the law (Clauset et al. 2009, SIAM Review 51, 661). Allowed is the 95 % interval of the \
estimate. Sizes are drawn one from each equal part of the law, so they scatter less. The published indices are for \
rocks of metres to hundreds of metres; no rock of an icy moon was measured at decimetres. `block_field` and \
`settled_snow` name comet 67P as their source and have its range. The others name Enceladus, whose index we could not \
read, and have the range from the comet to Eros. For Golombek's law, abundance and decay are fitted to the covered area.
* **Slopes.** A preset states one RMS slope. Where landforms, layers or snow change it by more than 5 %, the preset \
states the slope of the whole ground, measured at seeds 1 to 3. Allowed are 10 %, because a patch of 20 m has few \
of the longest waves. Hills of scenes are measured on 4 x 4 km without waves under 10 m, as in Galileo's terrain \
models, and are compared with Europa. The published range is for 10 to 100 m, so each distance is judged.
* **Exponents** are compared with the setting, for presets of the random surface alone. Allowed is 0.05 for the Hurst \
exponent: the surface is within 6 % of its law, and the distances span a factor of ten. Hills may differ by 0.1, \
because 4 km have few of their longest waves. Allowed is 0.2 for the exponent of the spectrum: twice 0.1 for the same \
6 %, because one patch has few waves of 3 m.
* **Curvature** has a kurtosis of 3 on a Gaussian surface. Allowed is 0.5, a sixth of the way to ground of plates. \
Ground of plates has its curvature at edges: the kurtosis is at least 6, and at most that of plates that are flat \
between edges. The row has the logarithm.
* **Shadows** under a point Sun are compared with two laws for Gaussian surfaces of the same RMS slope between \
points 4 cm apart. The closed form leaves out correlations; on Gaussian surfaces drawn by Fourier transform it \
is off by up to 0.058, so 0.06 is allowed. The other law is such a surface with the spectrum of the ground, where 0.03 \
is allowed for the chance of a patch. Where a law gives less than that, 0.01 is allowed.

No rows exist for these numbers, because we could not read them: the index of Enceladus' rocks (Pajola et al. 2021), \
the index of Bennu's boulders, Hurst exponents of Europa (Steinbrügge et al. 2020), of natural ground on Earth \
(Shepard et al. 2001), slopes of Enceladus, and measured shares in shadow. Slopes of Ganymede (3.5 to 8° over 630 m, \
Berquin et al. 2013) are of another moon.

Spectra of **images** have no row, because no published exponent for ice was found. Seen from above with Lambert's \
law, grounds of presets have exponents from 1.6 to 2.1 as long as some 20 % of the ground is lit, and edges of shadows \
have 2. Exponents under 1 appear where hardly anything is lit: `tiger_stripe_flank` under a Sun of 8° behind \
its slope has 0.3, with less than 1 % of lit ground. Lit crests are then single bright points, whose spectrum is flat. \
Exponents of such images say nothing about the ground.\
"""


def _compare_grounds(bench: Bench) -> list[Row]:
    seeds = SEEDS[:1] if bench.quick else SEEDS
    return [*make_rock_rows(seeds), *make_hill_rows(seeds), *make_relief_rows(seeds)]


COMPARISON = Comparison("ground", "Statistics of ground and rocks", _TEXT, _compare_grounds)
