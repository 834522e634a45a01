"""The state of the window for the open file: jobs, the shown pair, the first picture, and earlier states of views."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy

from ..settings.topics.scene import Settings
from ..stereo.pair_views import PairViews
from .first_picture import FirstPicture
from .jobs import Job
from .window_areas import redraw_panels, redraw_sidebars
from .window_events import make_registration
from .work_in_pieces import WorkInPieces

#: Numbers of vertices per side of the ground that follows a slider.
SIDES: tuple[int, ...] = (97, 129, 193, 257)


@dataclass
class ShownPair:
    """The pair and the view that the Image Editor shows."""

    folder: Path
    made_of: tuple[Any, ...]  # the folder, time and response from which it was developed
    views: PairViews
    view: str
    turn: int = 0  # index of the shown picture of the view


@dataclass(frozen=True)
class Exported:
    """The last export of a scene's source. It has a folder, empty if the export failed, and sentences on omitted files
    and errors. ``paths`` and ``settings`` are the exported folders and the settings then; ``title`` is the format's
    title."""

    folder: str
    sentences: tuple[str, ...]
    paths: tuple[Path, ...]
    settings: Settings
    title: str = ""


@dataclass
class Session:
    """The state of the window. Names of scenes and addresses of views hold for the open file only."""

    job: Job | None = None  # the job that the sidebar shows
    ended: str = ""  # how the last such job or build ended
    remains: str = ""  # the things that it left, if it was stopped
    ended_in: int = 0  # ``session_uid`` of the scene of that job; 0 for every scene
    reading: Job | None = None  # reads the pair that is shown next
    shown: ShownPair | None = None
    developing: Job | None = None  # develops the camera images that Image Editors show
    to_develop: set[str] = field(default_factory=set)  # scenes
    development_notes: list[str] = field(default_factory=list)  # warnings of the last development, or why it failed
    exported: dict[tuple[int, str], Exported] = field(default_factory=dict)  # by ``session_uid`` and source
    decided: dict[int, tuple[str, ...]] = field(default_factory=dict)  # where to dig, by ``session_uid`` of the scene
    building: Job | None = None  # builds a scene with coarse ground, piece by piece
    left_to_build: bool = False  # changed settings are not shown, because a build follows
    undone_build: bool = False  # the undo that runs now has stopped a build
    painting: Job | None = None  # paints decisions, piece by piece
    recolouring: WorkInPieces | None = None  # colours the shown errors again
    to_recolour: set[int] = field(default_factory=set)  # ``session_uid`` of the scenes whose errors will be coloured
    meshing: Job | None = None  # builds the ground at full resolution
    meshed_settings: Settings | None = None  # the settings of that ground
    shown_seconds: int = 0  # seconds of a wait, as the sidebar shows them
    marking: WorkInPieces | None = None  # reads the marks of the scene's meshes
    placing: WorkInPieces | None = None  # shows the scene with that ground
    changes: int = 0  # number of changes of the file that Blender has announced
    tracing: Job | None = None  # traces the shadow in a view
    to_trace: set[int] = field(default_factory=set)  # ``session_uid`` of the scenes whose shadow will be traced
    #: Notes on dark views, and the azimuth in degrees of a Sun that lights them, by ``session_uid``.
    shadow_notes: dict[int, tuple[str, float | None]] = field(default_factory=dict)
    to_preview: set[str] = field(default_factory=set)  # scenes with changes that the timer will show
    preview_side: int = SIDES[0]  # coarse at first, since the first step of a slider also replaces the built ground
    #: Addresses of the areas that showed the pair before an undo, which may remove its picture.
    pair_areas: list[int] = field(default_factory=list)
    #: Time at which the mouse button that holds a field was pressed, s of ``time.monotonic``; None if it is up.
    pressed_s: float | None = None
    to_show: list[Any] = field(default_factory=list)  # the functions that wait for a new Image Editor
    settings_before_undo: dict[int, Settings] = field(default_factory=dict)  # by ``session_uid`` of the scene
    traced_since_s: float = field(default_factory=time.monotonic)  # when the view began its present picture
    #: The clock's and the processor's seconds when the load of this Blender was measured last.
    load_measured_s: tuple[float, float] = field(default_factory=lambda: (time.monotonic(), time.process_time()))
    views_before: dict[int, dict[str, Any]] = field(default_factory=dict)  # 3D Views before they showed a built scene
    views_left: set[tuple[int, int]] = field(default_factory=set)  # views that left a built scene, and its session_uid
    shading_before: dict[int, dict[str, str]] = field(default_factory=dict)  # by 3D View, before it showed colours
    #: The views that no longer show colours, because undo or a button removed the errors, and whether they had Solid
    #: shading.
    colours_left: dict[int, bool] = field(default_factory=dict)
    #: The shading and the overlays of 3D Views before a mask was painted in them.
    before_painting: dict[int, tuple[str, bool]] = field(default_factory=dict)
    picture: FirstPicture = field(default_factory=FirstPicture)
    changed_without_step: bool = False  # data-blocks were replaced since the last undo step
    #: During an undo that reads all data-blocks: Blender's options for developers, *Undo Legacy*, and whether its
    #: preferences had changed.
    options_before_undo: tuple[bool, bool, bool] | None = None

    def reset(self) -> None:
        """Stop all jobs and forget the open file, before another is opened or Icy Moon is disabled."""
        every = self.job, self.reading, self.developing, self.building, self.painting, self.meshing, self.tracing
        running = [job for job in every if job is not None]
        for job in running:
            job.close()
        if self.placing is not None:
            self.placing.stop()
        self.picture.remove()
        vars(self).update(vars(Session()))
        if running:
            redraw_panels()

    def note_end(self, job: Job, outcome: str = "") -> None:
        """Note for the sidebar how a job or a build has ended, by default by the job's ``outcome``."""
        self.ended, self.ended_in = f"{job.title}: {outcome or job.outcome}", job.scene_uid
        self.remains = "" if outcome else job.remains

    def note(self, title: str, outcome: str, scene_uid: int) -> None:
        """Note for the sidebar how something without a job ended in the scene with this ``session_uid``."""
        self.ended, self.ended_in, self.remains = f"{title}: {outcome}", scene_uid, ""

    def find_end(self, scene: bpy.types.Scene) -> str:
        """Return how the last job of a scene ended; empty if a job of another scene has ended since."""
        return self.ended if self.ended_in in (0, scene.session_uid) else ""

    def show_seconds(self, seconds: int) -> None:
        """Redraw the sidebar for another whole second of a wait, so that a long wait is seen to go on."""
        if seconds != self.shown_seconds:
            self.shown_seconds = seconds
            redraw_sidebars()

    def stop_building(self) -> None:
        """Stop the build that runs piece by piece, before work that must not run beside it."""
        if self.building is not None:
            self.building.close()
            self.building = None

    def stop_painting(self) -> None:
        """Stop painting decisions."""
        if self.painting is not None:
            self.painting.close()
            self.painting = None


session = Session()
register, unregister = make_registration(
    load_pre=session.reset,
    undo_pre=lambda: session.picture.remove(),
    redo_pre=lambda: session.picture.remove(),
    end=session.reset,
)
