"""The folder and the plan of a data set."""

from __future__ import annotations

from .declaration import ELSEWHERE, Table, metres, number, text, tick
from .relevance import Condition, chosen, ticked

#: Ground that may be on a map.
FROM_MAP = chosen("source.kind", "HEIGHT_MAP")


class DatasetSettings(Table, label="Data Set"):
    """Folder and plan of a data set."""

    __slots__ = ()
    folder: str = text(
        "Folder", "~/icymoon", "Folder that the data set is written to. ~ is your home folder, // the folder of the "
        ".blend file", "run", "written", subtype="DIR_PATH")
    seed: int = number(
        "Seed", 1, 0, 2147483647, (0, 100), "The seed of everything random: terrain, rocks, grains, render noise and "
        "sensor noise", "geometry")
    headings: int = number(
        "Headings", 1, 1, 360, (1, 12), "Number of pairs at the site. The rig turns by equal steps between them; 4 "
        "for a panorama", "run", "pairs")
    plan: str = text(
        "Plan", "datasets/guiss_smoke", "Plan of a data set: a TOML file, or the name of a shipped plan. A plan does "
        "not use the present scene", "run", "read", section=ELSEWHERE,
        shown=Condition(lambda asked: asked.value("plan").endswith(".toml")))
    workers: int = number(
        "Workers", 0, 0, 1024, (0, 16), "Number of processes that render a data set at the same time; 0 for the "
        "number in the preferences, or one process per four processors", "run", "processes", zero="automatic",
        section=ELSEWHERE)
    evaluate: bool = tick(
        "Evaluate Afterwards", False, "Evaluate the whole data set after all pairs are rendered", "run",
        section=ELSEWHERE)
    leave_running: bool = tick(
        "Leave Running", False, "Continue to render the data set after Blender is closed or another file is opened. "
        "When Blender is opened again, the sidebar shows its progress", "run", section=ELSEWHERE)
    methods: str = text(
        "Matchers", "bm,sgbm", "Stereo matchers that Evaluate runs, separated by commas: bm, sgbm, sgbm_wls, jplv, "
        "igev, dsmnet, icynet. Options are written as in sgbm:window=7; own:NAME is a matcher that you set up in the "
        "preferences", "run", "matchers", section=ELSEWHERE)
    maps: bool = tick(
        "Write Maps (GeoTIFF)", False, "Evaluate also writes height, height error and missing areas as GeoTIFF, in "
        "the coordinate system of the ground's file", "run", section=ELSEWHERE, active=FROM_MAP, since="0.4")
    map_cell_m: float = metres(
        "Map Cell", 0.0, 0.0, 1000.0, (0.0, 1.0), "Width of a cell of these maps on the ground; 0 for three pixels or "
        "more at the median depth", "run", zero="automatic", section=ELSEWHERE, active=FROM_MAP, shown=ticked("maps"),
        since="0.4")
