"""Common mistakes of users and the errors that report them, for the page "When something goes wrong".

``tests/whole_program/test_mistakes.py`` makes each mistake and compares the error with this list.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Mistake:
    """``wrong`` is the user's mistake; ``message`` and ``fix`` are parts of the one sentence that reports it."""

    key: str
    wrong: str
    message: str
    fix: str


#: Mistakes by where they happen.
MISTAKES: dict[str, tuple[Mistake, ...]] = {
    "The evaluator": (
        Mistake(
            "no evaluator",
            "Evaluate is pressed before the evaluator is installed",
            "There is no evaluator yet",
            "press Install",
        ),
        Mistake(
            "wrong python",
            "The evaluator's path is that of a program that is not Python",
            "python: it prints nothing",
            "Install Python 3.11 or later and give its path",
        ),
        Mistake(
            "bare python", "The evaluator's Python lacks packages", "cannot evaluate: it lacks numpy", "-m pip install"
        ),
        Mistake("evaluator gone", "The evaluator's Python was moved", "does not exist", "correct the path"),
        Mistake("unknown matcher", "A matcher's name is misspelt", "Unknown matcher 'sgmb'", "did you mean 'sgbm'?"),
        Mistake(
            "unknown option", "A matcher's option is misspelt", "Unknown option bm.windw", "did you mean 'window'?"
        ),
        Mistake(
            "network without weights",
            "A network is chosen as a matcher and its weights are missing",
            "igev has no checkpoint at",
            "or give igev.checkpoint=FILE",
        ),
        Mistake(
            "nothing rendered",
            "Evaluate is pressed before Render",
            "The present settings have no rendered pair in",
            "press Render Stereo Pair first",
        ),
        Mistake(
            "empty data set",
            "A folder without pairs is evaluated",
            "contains no complete stereo pair",
            "render one first or choose another folder",
        ),
        Mistake(
            "half-written pair",
            "A pair whose render was interrupted is evaluated",
            "contains no complete stereo pair",
            "render one first or choose another folder",
        ),
    ),
    "Blender and the machine": (
        Mistake(
            "no blender", "`--blender` is not the path of a Blender", "Cannot start /nowhere/blender", "check its path"
        ),
        Mistake(
            "no osl",
            "Hapke's law is set to OSL in a Blender without OSL",
            "was built without Open Shading Language",
            "set hapke.backend to AUTO",
        ),
        Mistake(
            "no denoiser",
            "A denoiser is set in a Blender without it",
            "was built without OpenImageDenoise",
            "set quality.denoiser to NONE",
        ),
        Mistake(
            "no card",
            "A graphics card is set and the machine has none",
            "no graphics card",
            "set quality.device to CPU",
        ),
    ),
    "Files and folders": (
        Mistake(
            "unsaved",
            "The folder of the data set begins with //, and the .blend file is not saved",
            "dataset.folder is '//pairs', beside a .blend file that is not saved",
            "save it or choose a path that does not begin with //",
        ),
        Mistake(
            "read-only",
            "The folder of the data set is on a read-only disk",
            "the disk is read-only",
            "choose another folder",
        ),
        Mistake("full disk", "The disk is full", "the disk is full", "free some space or choose another folder"),
        Mistake(
            "little room",
            "The disk is too small for the pairs",
            "0 MB free",
            "free some space, choose another folder or render fewer pixels",
        ),
        Mistake(
            "file as folder",
            "A file has the name of the data set's folder",
            "a file of this name is in the way",
            "move it or choose another folder",
        ),
        Mistake(
            "texture gone", "A texture was moved", "frost.png: there is no such file", "check textures.albedo_file"
        ),
        Mistake(
            "not a texture",
            "A texture is not an image",
            "frost.png: is not an image that can be read",
            "give a PNG, JPEG, TIFF or EXR",
        ),
    ),
    "Settings, presets and plans": (
        Mistake(
            "unknown key", "A setting's name is misspelt", "unknown setting terrain.hurts", "did you mean 'hurst'?"
        ),
        Mistake("unknown topic", "A topic's name is misspelt", "unknown topic [terain]", "did you mean 'terrain'?"),
        Mistake("wrong units", "A length is in another unit", "terrain.size_m is 2e+07 m", "outside 0.01 to 100000 m"),
        Mistake("wrong type", "A number is in quotes", "terrain.size_m must be", "a number, not '20 m'"),
        Mistake(
            "wrong choice", "A choice's name is misspelt", "surface.model is 'LAMBERTIAN'", "did you mean 'LAMBERT'?"
        ),
        Mistake("not toml", "A bracket is missing in a settings file", "is not valid TOML", "line 1, column 9"),
        Mistake("bad --set", "`--set` has the wrong form", "--set terrain.size_m:20", "write it as topic.key=value"),
        Mistake(
            "unknown preset",
            "A preset's name is misspelt",
            "Unknown preset 'europe_rough_ice'",
            "did you mean 'scenes/europa_rough_ice'?",
        ),
        Mistake(
            "newer preset",
            "A preset was saved by a later version",
            "was saved by Icy Moon 9.0.0",
            "update Icy Moon to load it",
        ),
        Mistake(
            "impossible sweep",
            "A plan varies a setting over no values",
            "surface.albedo must list its values",
            "as in [0.9",
        ),
        Mistake(
            "no room for sites",
            "A plan asks for more sites than there is room for",
            "has room for 4 of 9 sites",
            "lower count",
        ),
    ),
    "Ground, camera and sky": (
        Mistake(
            "mesh in the wrong unit",
            "A mesh is so large that its unit must be wrong",
            "outside the size of a landing site",
            "set source.scale",
        ),
        Mistake(
            "mesh in centimetres",
            "A mesh of a site 300 m wide is in centimetres; it is built, with a warning",
            "is 3e+04 m wide; if its unit is not what you meant",
            "set source.scale",
        ),
        Mistake(
            "not a mesh",
            "A mesh file contains no mesh",
            "is not a PLY file, although its name ends so",
            "export the mesh again",
        ),
        Mistake(
            "unknown mesh format",
            "A file of an unknown format is imported",
            "is not a ground that Icy Moon reads",
            "choose one of .obj",
        ),
        Mistake("mesh gone", "The ground's file was moved", "gone.obj cannot be read", "check source.file"),
        Mistake(
            "no mesh chosen",
            "The ground is set to a file and no file is chosen",
            "source.file is empty",
            "choose a path",
        ),
        Mistake(
            "folder as mesh",
            "The ground's file is a folder",
            "site.obj cannot be read (it is not a regular file)",
            "check source.file",
        ),
        Mistake(
            "height map without scale",
            "A height map does not contain the size of its pixels",
            "does not state the size of its pixels",
            "set source.metres_per_pixel",
        ),
        Mistake(
            "camera under the ground",
            "The camera's height is negative",
            "rig.height_m is -1 m",
            "outside 0.001 to 10000 m",
        ),
        Mistake(
            "eye in the ground",
            "The right eye is in a hill",
            "has its right eye 4.82 m under the ground",
            "raise rig.height_m",
        ),
        Mistake(
            "eye in a rock",
            "The right eye is in a rock",
            "has its right eye in a rock",
            "change the site or raise rocks.clear_radius_m",
        ),
        Mistake(
            "motion without exposure",
            "The camera moves and its exposure is automatic",
            "The camera moves",
            "set rig.motion_exposure_s",
        ),
        Mistake(
            "no date",
            "A date is written in words",
            "light.date_utc is 'next summer'",
            "write it as 2035-03-01T12:00:00",
        ),
        Mistake("unknown body", "A moon that needs kernels is set", "light.body is 'TITANIA'", "give light.kernels"),
        Mistake(
            "kernels gone",
            "The kernels were moved",
            "none.tm, which is not there",
            "give a meta-kernel or a folder of kernels",
        ),
        Mistake(
            "kernels without the date",
            "The kernels do not cover the body or the date",
            "cannot give the sky of ENCELADUS",
            "add kernels that cover body and date",
        ),
        Mistake(
            "edited by hand",
            "Ground was edited by hand, and a setting of it was changed before the render",
            "terrain.hurst was changed after the scene was built and edited by hand",
            "press Build Scene to build it again",
        ),
    ),
}
