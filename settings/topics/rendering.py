"""Noise, bias and speed of a render, and the files that it stores."""

from __future__ import annotations

from typing import Literal

from .declaration import ADVANCED, Section, Table, choice, number, tick
from .ground import PROCEDURAL
from .relevance import chosen, ticked

#: Laws of reflectance that use ``fine_relief``.
_WITH_NORMAL = (chosen("surface.model", "LAMBERT", "PRINCIPLED")
                | (ticked("rocks.own_surface") & chosen("rock_surface.model", "LAMBERT", "PRINCIPLED")))
TRUTH = Section("truth", "Truth", "Truth that is rendered with the images, and how")
INDIRECT = Section("indirect", "Indirect Light", "Light between parts of the ground, baked once for many images")


class QualitySettings(Table, label="Quality and Speed", brief="Quality"):
    """Noise, bias and speed of a render."""

    __slots__ = ()
    samples: int = number("Samples", 32, 1, 65536, (1, 1024), "Light paths per pixel and eye", "sampling", "samples")
    denoiser: Literal["NONE", "OIDN", "OIDN_COLOUR"] = choice(
        "Denoiser", "NONE", "Denoiser of the images of both eyes. The truth has no noise", "sampling",
        ("NONE", "None", "Keep the noise of the render in the images"),
        ("OIDN", "OpenImageDenoise", "Remove the noise at low cost. The noise-free albedo and normals that guide the "
         "denoiser make stereo matching easier than it is"),
        ("OIDN_COLOUR", "OIDN, Colour Only", "Remove the noise without albedo and normals. This smooths fine texture "
         "away"))
    noise_threshold: float = number(
        "Noise Threshold", 0.0, 0.0, 1.0, (0.0, 0.1),
        "Relative noise at which sampling of a pixel stops, after at least 16 threshold^-0.3 samples; 0 gives"
        " all pixels the same number. It saves time but makes the noise uneven",
        "sampling", zero="off", section=ADVANCED)
    diffuse_bounces: int = number(
        "Bounces", 4, 0, 128, (0, 16), "Maximum number of diffuse bounces. With 4, even ice of albedo 1 has more than "
        "99 % of its light", "sampling", "bounces", section=ADVANCED)
    walk_px: float = number(
        "Subsurface Cutoff (px)", 0.1, 0.0, 100.0, (0.0, 1.0), "Radius of subsurface scattering, in pixels of the "
        "nearest level ground, below which light leaves where it enters. This changes its amount by at most 3 %; 0 "
        "for no cutoff", "material", "px", zero="off", section=ADVANCED)
    fine_relief: Literal["ALL", "CAMERA"] = choice(
        "Light on Relief", "ALL", "Light whose shading includes bump and normal images. Only Lambert and Principled "
        "ice without subsurface scattering use this setting", "material",
        ("ALL", "All Light", "Also light that other ground reflects"),
        ("CAMERA", "Camera Rays Only", "Other ground reflects light as if it were smooth, which saves a tenth of the "
         "time. Under a low Sun, shadows are 2 to 5 % brighter and the mean up to 0.3 %"),
        section=ADVANCED, shown=_WITH_NORMAL)
    indirect: Literal["TRACED", "BAKED", "AUTO"] = choice(
        "Indirect Light", "TRACED", "How light that other ground reflects is computed. Only Lambert ground and rocks "
        "can be baked; other scenes are traced, and pair.json contains why", "material",
        ("TRACED", "Traced", "Followed through every pixel, with Samples paths"),
        ("BAKED", "Baked", "Computed once at the vertices of the ground. Images then trace only direct light, with "
         "few samples and without a denoiser"),
        ("AUTO", "Automatic", "Baked if the data set has enough images of one ground under one Sun to save time, "
         "otherwise traced"),
        section=INDIRECT, since="0.3")
    direct_samples: int = number(
        "Direct Samples", 4, 1, 65536, (1, 64), "Light paths per pixel and eye where indirect light is baked. There "
        "is no denoiser then", "sampling", "samples", section=INDIRECT, shown=~chosen("indirect", "TRACED"),
        since="0.3")
    bake_area: Literal["GROUND", "VIEW"] = choice("Bake Area", "GROUND", "Ground whose light is baked", "sampling",
        ("GROUND", "Whole Ground", "Images in all directions share it"),
        ("VIEW", "Seen Ground",
            "Ground that the cameras see. It is faster but suits few images, because only images from one place "
            "in one direction share it"),
        section=INDIRECT, shown=~chosen("indirect", "TRACED"), since="0.3")
    bake_samples: int = number(
        "Bake Samples", 256, 4, 65536, (64, 1024), "Maximum number of light paths per corner of the ground's mesh for "
        "baked light, unless Bake Noise is reached before. With less than 64, matchers look better than they "
        "are", "sampling", "samples", section=INDIRECT, shown=~chosen("indirect", "TRACED"), since="0.3")
    bake_noise: float = number(
        "Bake Noise", 0.01, 0.0, 1.0, (0.0, 0.05),
        "Noise of baked light, relative to all light, at which sampling stops; with more noise, an image is "
        "traced. It looks like texture, so keep it below the sensor's noise; 0 for no limit",
        "sampling", section=INDIRECT, shown=~chosen("indirect", "TRACED"), since="0.3")
    files: Literal["COMPACT", "FULL"] = choice(
        "Files", "COMPACT", "How values are stored. Depth, labels and hidden pixels are always exact", "run",
        ("COMPACT", "Compact",
            "Radiance and normals in 16 bits: light is rounded by at most 0.05 %, far below its noise, normals by"
            " at most 0.03°. The image is not stored, because it is the sum of the stored lights"),
        ("FULL", "Full",
            "All values in 32 bits as rendered, except for those that Half Floats states. Files are about twice "
            "as large"),
        section=ADVANCED, since="0.3", before="FULL")
    half_floats: Literal["NONE", "RADIANCE", "RADIANCE_NORMALS"] = choice(
        "Half Floats", "NONE",
        "Values that full files store in 16 instead of 32 bits. Unlike Files, it changes the ids of pairs", "sampling",
        ("NONE", "Nothing", "All values as rendered"),
        ("RADIANCE", "Radiance", "Rounded by at most 0.05 %. Files are a quarter smaller with the whole truth, and "
         "half with depth alone"),
        ("RADIANCE_NORMALS", "With Normals", "Radiance as well as normals, which are off by at most 0.03°. Files are "
         "half as large"),
        section=ADVANCED, since="0.3")
    truth: Literal["FULL", "SEMANTIC", "DEPTH"] = choice(
        "Truth", "FULL", "Truth that is rendered with the images", "sampling",
        ("FULL", "Full", "Depth, normals and labels, in a separate render with one sample per pixel"),
        ("SEMANTIC", "No Normals",
            "Depth and the kind of each pixel (ground, rock, lander, planet), both from the render of the images,"
            " without normals and labels of single rocks"),
        ("DEPTH", "Depth Only", "Depth from the render of the images. This saves the separate render unless the "
         "images are blurred or toed in"),
        section=TRUTH)
    truth_by: Literal["RAYS", "CYCLES"] = choice(
        "Truth Method", "RAYS", "Method for truth that does not come with the images", "run",
        ("RAYS", "Rays",
            "Rays through the triangles that are rendered. Cycles renders the truth of scenes that rays cannot "
            "reproduce, and the pair states why"),
        ("CYCLES", "Cycles", "Four more renders, with shading normals beside those of facets"),
        section=TRUTH, since="0.3", before="CYCLES")
    loose_thickness: bool = tick(
        "Loose Material", False, "Add the thickness of loose material above the hard ground to the full truth by rays: "
        "talus, snow in hollows, skirts of rocks and spoil, along the vertical", "sampling", section=TRUTH,
        shown=chosen("truth", "FULL") & chosen("truth_by", "RAYS") & PROCEDURAL, since="0.4")
    device: Literal["CPU", "GPU"] = choice("Device", "CPU", "Processor that renders", "run",
        ("CPU", "CPU", "All processor cores"),
        ("GPU", "GPU", "The graphics cards that Cycles can use. Render Stereo Pair refuses it if there are none"),
        section=ADVANCED)
    threads: int = number(
        "Threads", 0, 0, 1024, (0, 64), "Number of processor threads; 0 for all", "run", "threads", zero="all",
        section=ADVANCED)
