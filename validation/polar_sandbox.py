"""NASA's POLAR sandbox: a real scene that is built and rendered again."""

from __future__ import annotations

from .comparison import Bench, Comparison, Row


def _compare(bench: Bench) -> list[Row]:
    from .polar_comparison import compare  # which needs OpenCV

    return compare(bench)


COMPARISON = Comparison(
    "polar",
    "A real scene",
    "Rocks on sand under one lamp in a dark room, which NASA Ames photographed with a stereo camera (POLAR). POLAR-Sim "
    "(Chen et al., arXiv 2309.12397, github.com/uwsbel/POLAR-Sim, CC0 1.0) scanned the rocks and outlined rocks and "
    "shadows by hand. The scene is built again from scans and survey, and rendered with a lamp near the ground and "
    "`surfaces/hapke_lunar_like`. Fitted first are: the camera, to the upper outlines of the rocks (focal lengths, "
    "principal points, two terms of distortion, the right eye beside the left one, a pose for each position); height "
    "and tilt of the sand at each rock, to the outlines in the left eyes; the place of each lamp and the sand between "
    "the rocks, to the shadows in the left eyes. The right eyes were outlined separately and show what was not fitted "
    "to them. Their outlines are rectified into our rig, and images have 480 columns. A pixel is rock where it is "
    "nearer than the sand, and shadow where it has less than half of the light that it has without rocks. The lamp's "
    "diameter of 0.5° is chosen. Causes were tried with masks that are drawn and not rendered, as means of all views. "
    "Rocks: 0.83 as here; 0.84 if the sand may bend at rocks, 0.85 if scans may also move by millimetres and turn by a "
    "degree. Shadows beside the outlined rocks: lamps alone 0.62, with sand raised every 0.25 m 0.73, every 0.15 m "
    "0.75, but so uneven sand casts shadows of its own, and tips are then 10 % too long: with rays cast at the scans, "
    "as the render does, every 0.25 m gives 0.71 and every 0.15 m 0.71, and 0.69 where each height takes more steps. "
    "Sand that rises to the feet of rocks was tried too, with rays cast: 5 mm, falling off over 1.5 cm (both fitted), "
    "gain 0.002 in shadows and lose 0.003 in rocks, and 5 mm less lose 0.014 in shadows; a height of its own for each "
    "rock, falling off over 2 cm (assumed) and fitted to a few photographs, gains 0.001 to 0.007 in the shadows of 16 "
    "others and loses 0.002 to 0.006 in their rocks, so it is not built. "
    "Nor is a smooth sand (cubic splines every 7 or 10 cm) that was fitted to 6158 points, each where the line of "
    "sight of an outlined edge of a shadow in a left eye meets the shadow that a scan casts, and to feet of rocks, "
    "with the lamps. Edges are met to a median of 1 to 5 pixels of the photographs, but rays cast in the right eyes "
    "give shadows of 0.71 to 0.74 at A, 0.61 to 0.63 at B and 0.70 to 0.73 at C, and rocks of 0.80 to 0.84, by how "
    "stiff sand and lamps are. Tips gain: with lamps held to 3 cm they are 1.5 % too long and 5.5 % off in size, and "
    "outlined tips differ by 3.2 % between positions. Shadows that were outlined at A, laid on that sand and seen "
    "from B, agree with those outlined at B to 0.55 to 0.75, with what rocks hide counted. A lamp of its own for each "
    "photograph gains 0.003 to 0.006, so lamps that moved between positions are no cause. Scans that move by 1 to 5 "
    "mm and turn by up to 1.3° (5 mm and 1° were expected) meet upper outlines to 1.0 pixels in place of 1.4, but "
    "change the masks of rocks by 0.005 or less. "
    "Two pixels of the photographs around our masks, more or less, lose 0.03 to 0.09 in both, so it is neither the "
    "penumbra nor a threshold. Where shadows are apart, by masks cast so, as means of shares of the union: 16 % within "
    "a pixel of an outline, 5 % where the other mask shows rock, 2 % in shadows that only one has, of stones that were "
    "not scanned or not outlined, 3 % at feet of rocks, 3 % elsewhere. A pixel of these images is 7 to 9 mm at the "
    "rocks, and outlines moved by a pixel to the side agree with themselves to 0.81 to 0.88. Of the 27 or 28 outlines "
    "of rocks of a photograph, 24 to 27 at position C are those of another lamp to the last digit, and up to 18 at B; "
    "copies are not compared. The data are not shipped: FOLDER has `rocks/terrainTT_rockN.obj` and "
    "`labels/TT_P_off_AZ_E.txt` for each terrain TT, camera position P, azimuth AZ and eye E. Pictures of labels, "
    "masks and renders side by side are written beside the tables.",
    _compare,
    quick=False,
    needs="polar",
    figure="![Labels, our masks and our renders of four lamps](../images/polar_twins.jpg) "
    "Position A, right eye, lamps at 30, 180, 270 and 350°: POLAR-Sim's outlines of rocks and shadows, ours, and our "
    "render (`polar/terrain04/twins_A_R.png`).",
)
