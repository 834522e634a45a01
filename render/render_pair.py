"""Renders one pair of a built scene into its folder."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..formats.exr_add import add_baked, add_group, is_sum_of_lights, measure_baked_noise
from ..formats.exr_layout import is_whole
from ..formats.exr_parts import Piece, assemble, join_layers, read_pieces
from ..formats.exr_pixels import compress, drop_passes, round_passes
from ..nodes.build_scene import Built
from ..nodes.datablocks.fingerprint import find_built_objects
from ..nodes.head_cameras import read_head_cameras
from ..nodes.lander.objects import ROLES
from ..nodes.light.sun_lamp import build_sky
from ..nodes.light.veil import add_veil_temporarily
from ..nodes.rig import find_eye_poses, list_lens_values, turn_about_eye
from ..nodes.surface.sun_inputs import prepare_for_cycles
from ..physics.arm.lander_solids import HEAD
from ..physics.camera.blur import Blur, check_truth_of_rows, find_blur, has_rolling_shutter
from ..physics.camera.eyes import make_camera_with_eyes
from ..physics.camera.rolling_shutter import find_rolling_shutter
from ..physics.camera.stereo_camera import StereoCamera
from ..physics.scene_requirements import are_rocks_clear, can_be_baked, make_direct_quality
from ..rays.stereo_truth import Stage
from ..settings.topics.rendering import QualitySettings
from ..settings.topics.scene import Settings
from ..support import system
from ..support.arrays import Array
from ..support.errors import DiskError, IcyMoonError, find_first_line
from ..support.files import explain_disk_errors, hash_file, make_part_path, write_json
from ..support.foreign_bytes import OverBudgetError
from ..support.labels import BAKED_ERROR_PASSES, BEAUTY, IMAGE_PASS, TRUTH, list_rounded_passes
from ..support.number_text import format_count
from . import cycles_occlusion, cycles_settings, passes, separate_lights, truth_without_light
from .baked_light import IndirectLight
from .cost.estimate import count_pixels, estimate_remaining_bytes
from .ground_maps import make_heights, make_materials
from .lander_record import make_lander_json
from .object_labels import label_temporarily
from .pair_record import make_light_json, make_pair_json
from .pairs.baked_file import LIGHT
from .pairs.dataset_file_names import check_no_link, pairs_folder
from .pairs.pair_folder import RAW_TRUTH_FILE, TOED_TRUTH_FILE, TRUTH_FILE
from .pairs.publish_pair import check_place, discard_unfinished, publish_pair
from .pairs.workspace_cells import MATERIALS_FILE, WORKSPACE_FILE, find_workspace_extent, list_workspace_files
from .plans.planned_pair import PlannedPair
from .progress import watch_samples
from .ray_stage import CannotTrace, SceneRays
from .ray_truth import TruthRequest, trace_in_background
from .render_camera import add_render_camera, set_up_camera, shift_frame
from .render_head import render_head
from .workers.pair_claims import CLAIMS_FOLDER

#: Bytes per pixel of a pair in Blender's own uncompressed files: 32-bit floats of all passes of the light, and of the
#: truth if Cycles renders it.
_TEMPORARY_BYTES_PER_PIXEL = 4 * 48


#: Most triangles for which Cycles' data is kept between two renders, which takes half a gigabyte more.
MAX_KEPT_TRIANGLES = 8_000_000
_TRACED_LIGHT = IndirectLight()
#: The eye in whose image the noise of a pair is judged: only its file has the error of baked light.
_NOISE_JUDGED_EYE = "left"


@contextmanager
def open_render_scene(built: Built, frame: int) -> Iterator[bpy.types.Scene]:
    """Yield a separate scene that shows the built collection under a black sky, for any number of pairs.

    The user's scene is never changed for a render, so nothing has to be restored. The separate scene is always removed
    at the end. As long as no object is added or removed, Cycles keeps its tree of triangles for the next render, such
    as the truth after the radiance, unless there are too many triangles.
    """
    scene = bpy.data.scenes.new("Icy Moon Render")
    sky = build_sky("Icy Moon Render Sky")
    try:
        scene.collection.children.link(built.collection)
        scene.world = sky
        scene.frame_set(frame)
        groups = [lamp.lightgroup for lamp in built.lamps]
        passes.prepare_scene(scene, built.several_lights, can_be_baked(built.settings), groups)
        with add_render_camera(scene, built.camera), label_temporarily(scene):
            yield scene
    finally:
        scene.render.use_persistent_data = False  # frees the data that Cycles keeps
        bpy.data.scenes.remove(scene)
        bpy.data.worlds.remove(sky)


def _count_triangles(built: Built) -> int:
    """Count the triangles of the collection's meshes; a mesh with several instances counts once."""
    meshes = {item.data for item in built.collection.all_objects if isinstance(item.data, bpy.types.Mesh)}
    return sum(len(mesh.loops) - 2 * len(mesh.polygons) for mesh in meshes)


def _turn_head(built: Built, turn_deg: float) -> AbstractContextManager[None]:
    """Turn the lander's head with the cameras in it, until the end of the ``with`` block; without a lander do
    nothing.
    """
    head = find_built_objects(built.collection).get(ROLES[HEAD])
    return turn_about_eye(head, turn_deg, built.camera) if head is not None else nullcontext()


def check_space(dataset: Path, pairs: list[PlannedPair], again: bool = False) -> None:
    """Raise IcyMoonError if the folder cannot be made or its disk has no room for the remaining pairs."""
    check_no_link(pairs_folder(dataset), dataset / CLAIMS_FOLDER, dataset / LIGHT)
    with explain_disk_errors("write to", dataset):
        dataset.mkdir(parents=True, exist_ok=True)
        probe = make_part_path(dataset / ".icymoon")
        probe.write_bytes(b"")
        system.remove(probe)
        free = shutil.disk_usage(dataset).free
    left = estimate_remaining_bytes(pairs, dataset, again)
    needed = left + _TEMPORARY_BYTES_PER_PIXEL * max(count_pixels(pair.settings) for pair in pairs) if left else 0.0
    if needed > free:
        raise IcyMoonError(
            f"{dataset} has {free / 1e6:.0f} MB free, {format_count(len(pairs), 'pair')} may need "
            f"{needed / 1e6:.0f} MB more; "
            "free some space, choose another folder or render fewer pixels."
        )


def render_pair(
    built: Built,
    scene: bpy.types.Scene,
    planned: PlannedPair,
    dataset: Path,
    seconds_build: float,
    report: Callable[[float], None],
    lost: Callable[[], bool],
    rays: SceneRays,
    again: bool = False,
    indirect: IndirectLight = _TRACED_LIGHT,
) -> Path:
    """Render one pair of the scene that ``open_render_scene`` made and return its folder.

    ``rays`` are the rays through that scene. ``indirect`` is from ``baked_light.provide_baked_light``. ``report``
    receives the fraction done; for ``lost`` and ``again`` see ``publish_pair``. Raises IcyMoonError when the render or
    the disk fails; nothing half-written stays.
    """
    folder = planned.folder(dataset)
    check_place(folder)
    part = make_part_path(folder)
    spent = time.process_time()
    with explain_disk_errors("write", folder):
        part.mkdir(parents=True)
    try:
        found = _render_into(part, built, scene, planned, report, indirect, rays)
        if why := indirect.find_why_traced(found.get("indirect"), planned.settings.quality.bake_noise):
            traced = IndirectLight(why_traced=why, tried=indirect.lights)
            found = _render_into(part, built, scene, planned, report, traced, rays)
        found["seconds"]["build"] = round(seconds_build, 3)
        # Processor seconds of all threads. "before" is the time that this process had already spent: its start, the
        # build, other pairs and their bakes.
        found["cpu_seconds"] = {
            "before": round(spent - indirect.spent_s, 3),
            "pair": round(time.process_time() - spent, 3),
        }
        write_json(part / "pair.json", found)
        publish_pair(part, folder, lost, again)
    finally:
        discard_unfinished(part)
    return folder


def check_camera(built: Built) -> None:
    """Raise IcyMoonError if the camera was changed by hand into one that the settings do not describe."""
    stereo = built.camera.data.stereo
    if (stereo.convergence_mode, stereo.pivot) != ("PARALLEL", "LEFT"):
        raise IcyMoonError(
            f"The stereo camera's eyes are set to {stereo.convergence_mode.lower()} about "
            f"{stereo.pivot.lower()}; set its convergence to Parallel and its pivot to Left, and "
            "rig.toe_in_deg to turn the eyes in."
        )
    if built.camera.data.dof.use_dof:
        raise IcyMoonError(
            "The stereo camera has its own depth of field, which would blur the true depth too; "
            "switch it off, and set rig.focus_distance_m instead."
        )
    rig = built.settings.rig
    wanted = {**list_lens_values(rig), "interocular_distance": ("rig.baseline_m", rig.baseline_m)}
    for name, (setting, value) in wanted.items():
        there = getattr(stereo if name == "interocular_distance" else built.camera.data, name)
        if there != value and (isinstance(value, str) or abs(there - value) > 1e-5 * max(1e-3, abs(value))):
            raise IcyMoonError(
                f"The stereo camera's {name.replace('_', ' ')} was changed by hand to {there}, which "
                f"the calibration does not contain; set it back, and set {setting} instead."
            )


@dataclass(frozen=True)
class _CameraSetup:
    """Renders with one camera: its layers, and the name of each layer's file, with {} for the eye."""

    blur: Blur | None
    toed: bool
    images: tuple[tuple[str, str], ...]
    wide: bool = False


def _has_full_truth(planned: PlannedPair) -> bool:
    """Return whether truth takes a separate render."""
    return planned.settings.quality.truth == "FULL"


def _list_camera_setups(camera: StereoCamera, blur: Blur | None, full: bool) -> list[_CameraSetup]:
    """List the renders by camera: one camera renders radiance and truth, unless they need different cameras."""
    toed, wide = camera.toe_in_deg != 0, camera.panorama is not None
    if blur is None and not toed and not wide:
        images = ((BEAUTY, "{}.exr"), (TRUTH, "{}.exr")) if full else ((BEAUTY, "{}.exr"),)
        return [_CameraSetup(None, False, images)]
    light = _CameraSetup(blur, toed, ((BEAUTY, "{}.exr"),), wide)
    takes = [light, _CameraSetup(None, False, ((TRUTH, TRUTH_FILE),))]
    return [*takes, _CameraSetup(None, True, ((TRUTH, TOED_TRUTH_FILE),))] if toed else takes


@dataclass(frozen=True)
class _Rendered:
    """The results of a pair's renders, before its files are assembled."""

    files: dict[str, dict[str, Path]]  # by name in the pair, then by layer
    poses: dict[str, Any]
    light: dict[str, Any]
    engine: dict[str, str]  # the pair's statement about its truth
    seconds: dict[str, float]
    head: list[dict[str, Any]]  # the entries of the cameras beside the pair


def _render_into(
    part: Path,
    built: Built,
    scene: bpy.types.Scene,
    planned: PlannedPair,
    report: Callable[[float], None],
    indirect: IndirectLight,
    rays: SceneRays,
) -> dict[str, Any]:
    """Render a pair into the folder ``part`` and return the content of its pair.json."""
    settings = planned.settings
    quality = make_direct_quality(settings.quality) if indirect.lights else settings.quality
    rounded = list_rounded_passes(quality.files, quality.half_floats)
    made = _render_takes(part, built, scene, planned, report, bool(indirect.lights), rays, quality, rounded)
    start = time.perf_counter()
    written, shares, noise_of_image = _write_files(part, made.files, planned, bool(indirect.lights), rounded)
    written |= {name: _describe_file(part / name) for name in list_workspace_files(settings.workspace)}
    seconds = {**made.seconds, "write": round(time.perf_counter() - start, 3)}
    return {
        **make_pair_json(
            built,
            planned,
            made.poses,
            made.light,
            written,
            seconds,
            quality.denoiser,
            indirect.to_json(shares, noise_of_image),
            made.head,
        ),
        **({"truth": made.engine} if made.engine else {}),
        **make_lander_json(built, settings, made.poses, part),
    }


def _count_truths(takes: list[_CameraSetup], planned: PlannedPair) -> int:
    """Count the truth renders of Cycles for a pair."""
    images = sum(layer == TRUTH for take in takes for layer, _ in take.images)
    return images + (len(cycles_occlusion.STEPS_PX) if _has_full_truth(planned) else 0)


def _render_takes(
    part: Path,
    built: Built,
    scene: bpy.types.Scene,
    planned: PlannedPair,
    report: Callable[[float], None],
    baked: bool,
    rays: SceneRays,
    quality: QualitySettings,
    rounded: set[str],
) -> _Rendered:
    """Render radiance and truth by all cameras of the pair. ``baked`` is whether the light of the ground is baked."""
    settings = planned.settings
    camera, blur, others = make_camera_with_eyes(settings), find_blur(settings), len(read_head_cameras(settings))
    takes = _list_camera_setups(camera, blur, _has_full_truth(planned)) if settings.rig.images == "PAIR" else []
    files: dict[str, dict[str, Path]] = {}
    start = time.perf_counter()
    with turn_about_eye(built.camera, planned.turn_deg), _turn_head(built, planned.turn_deg):
        lights = _prepare_cycles(scene, built, planned, quality, blur is not None, baked)
        poses = find_eye_poses(built.camera.matrix_world, built.camera.data.stereo.interocular_distance)
        rows, clip_m = _list_row_poses(settings, poses), (built.camera.data.clip_start, built.camera.data.clip_end)
        stage, asked, engine = _plan_rays(part, rays, settings, takes, camera)
        head_stage = _open_ray_stage(rays, "of cameras beside the pair", "empty rig.head_file") if others else None
        truths = 0 if asked.keys() - {_SENSOR_TRUTH_NUMBER} or not takes else _count_truths(takes, planned)
        with (
            watch_samples(len(lights) * int(quality.samples), truths, report, others, 2 * bool(takes)) as sampling,
            trace_in_background(stage, asked, camera, rows, clip_m, settings.quality.truth, rounded) as traced,
        ):
            for k, take in enumerate(takes):
                with set_up_camera(scene, built.camera, camera, take.blur, take.toed, take.wide):
                    scene.render.use_motion_blur = take.blur is not None and take.blur.exposure_s is not None
                    for layer, name in take.images:
                        stem = part / f"{layer}{k}"
                        if layer == BEAUTY:
                            made = _render_radiance(scene, built, lights, stem, planned)
                        elif k in traced:
                            made = traced[k].result()
                        else:
                            made = _render_truth(scene, built, stem, planned, camera, take.toed)
                        for eye, file in made.items():
                            files.setdefault(name.format(eye), {})[layer] = file
            files |= _list_sensor_files(traced)
            render = partial(_render_light, scene, built, lights, planned=planned, truth="FULL")
            more, head = render_head(part, built, scene, head_stage, settings, rounded, render)
            files |= more
        light = make_light_json(built, settings.light.directions_from)
        if settings.workspace.cell_m > 0:
            _write_workspace(part, rays, built, scene.frame_current)
    seconds = {"render": round(time.perf_counter() - start, 3), "sampling": round(sampling.seconds, 3)}
    if head_stage and not takes:
        engine = {"by": head_stage.ground_tracer.name}
    return _Rendered(files, poses, light, engine, seconds, head)


def _list_row_poses(settings: Settings, poses: Mapping[str, Array]) -> Mapping[str, Array]:
    """List the poses from which the rows of the eyes are traced: ``poses`` (4, 4) at the middle of the exposure or,
    with a rolling shutter, the pose of each rendered row (rows, 4, 4)."""
    camera, shutter = make_camera_with_eyes(settings), find_rolling_shutter(settings.rig)
    if shutter is None:
        return poses
    return {eye: shutter.list_poses(pose, camera.find_offset_m(eye), camera.margin_y_px) for eye, pose in poses.items()}


def _prepare_cycles(
    scene: bpy.types.Scene, built: Built, planned: PlannedPair, quality: QualitySettings, blurred: bool, baked: bool
) -> list[separate_lights.LightPass]:
    """Set up Cycles for the radiance of a pair, and return its lights; each takes a render."""
    cycles_settings.apply_quality(scene, quality, planned.render_seed, blurred, are_rocks_clear(planned.settings))
    if baked:
        scene.cycles.max_bounces = 0
    prepare_for_cycles(scene, built.materials, built.sun, built.planetshine, built.lamps)
    lights = separate_lights.list_light_passes(scene, built)
    # Cycles does not keep objects that move during a render, nor surfaces that change between two renders.
    scene.render.use_persistent_data = (
        not blurred
        and len(lights) == 1
        and not scene.cycles.shading_system
        and _count_triangles(built) <= MAX_KEPT_TRIANGLES
    )
    return lights


def _write_files(
    part: Path, files: dict[str, dict[str, Path]], planned: PlannedPair, baked: bool, rounded: set[str]
) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, float]], float | None]:
    """Assemble the layers into the files of the pair, and add baked light.

    Returns the facts of each file, the share of baked light by eye, and its noise in the judged image, if any.
    """
    written: dict[str, dict[str, Any]] = {}
    shares: dict[str, dict[str, float]] = {}
    noise_of_image = None
    for name, layers in sorted(files.items()):
        with _report_unreadable(planned):
            found = _read_layers(layers, part / name)
            unwanted = {*BAKED_ERROR_PASSES.values()}
            if baked and BEAUTY in found:
                found[BEAUTY], shares[Path(name).stem] = add_baked(found[BEAUTY])
                if name == f"{_NOISE_JUDGED_EYE}.exr":
                    noise_of_image, unwanted = measure_baked_noise(found[BEAUTY]), set()
            compact = planned.settings.quality.files == "COMPACT"
            written[name] = _write_layers(found, part / name, rounded, compact, unwanted)
    return written, shares, noise_of_image


def _choose_engine(
    rays: SceneRays, settings: Settings, takes: list[_CameraSetup]
) -> tuple[Stage | None, dict[str, str]]:
    """Choose whether traced rays or Cycles find the truth. Return the stage for rays, None for Cycles, and the pair's
    statement about this choice, empty if truth comes with the radiance."""
    if all(layer == BEAUTY for take in takes for layer, _ in take.images):
        return None, {}
    if has_rolling_shutter(settings.rig):
        check_truth_of_rows(settings)
        stage = _open_ray_stage(rays, "of a rolling shutter", "set rig.readout_s to 0")
        return stage, {"by": stage.ground_tracer.name}
    if settings.quality.loose_thickness:
        stage = _open_ray_stage(rays, "of the thickness of loose material", "set quality.loose_thickness to false")
        return stage, {"by": stage.ground_tracer.name}
    if settings.quality.truth_by == "CYCLES":
        return None, {"by": "Cycles"}
    try:
        stage = rays.prepare()
    except CannotTrace as reason:
        return None, {"by": "Cycles", "why": str(reason)}
    return stage, {"by": stage.ground_tracer.name}


#: Among the truths by rays, the number of the truth on the sensors of calibrated eyes. Other truths have the number of
#: their render.
_SENSOR_TRUTH_NUMBER = -1


def _plan_rays(
    part: Path, rays: SceneRays, settings: Settings, takes: list[_CameraSetup], camera: StereoCamera
) -> tuple[Stage | None, dict[int, TruthRequest], dict[str, str]]:
    """Return the stage for rays, the truths that rays find, by number, and the statement of ``_choose_engine``. Rays
    find the truth of ``takes``, unless Cycles renders it, and the truth on the sensors of calibrated eyes."""
    stage, engine = _choose_engine(rays, settings, takes)
    asked: dict[int, TruthRequest] = {
        k: (part / f"{TRUTH}{k}", "TOED" if take.toed else "PARALLEL")
        for k, take in enumerate(takes)
        if stage and TRUTH in dict(take.images)
    }
    if camera.eyes and takes:
        asked[_SENSOR_TRUTH_NUMBER] = part / f"{TRUTH}-sensors", "SENSORS"
        stage = stage or _open_ray_stage(rays, "on the sensors of calibrated eyes", "set rig.eyes to ALIKE")
    return stage, asked, engine


def _list_sensor_files(traced: Mapping[int, Future[dict[str, Path]]]) -> dict[str, dict[str, Path]]:
    """List the files of the truth on the sensors of calibrated eyes, by name in the pair and by layer."""
    found = traced[_SENSOR_TRUTH_NUMBER].result() if _SENSOR_TRUTH_NUMBER in traced else {}
    return {RAW_TRUTH_FILE.format(eye): {TRUTH: file} for eye, file in found.items()}


def _open_ray_stage(rays: SceneRays, whose: str, fix: str) -> Stage:
    """Return the stage for a truth that Cycles cannot render. Raises IcyMoonError if rays cannot find it either."""
    try:
        return rays.prepare()
    except CannotTrace as reason:
        raise IcyMoonError(
            f"The truth {whose} must come from rays, which is not possible here: {reason}; {fix}, or remove this cause."
        ) from None


def _write_workspace(part: Path, rays: SceneRays, built: Built, frame: int) -> None:
    """Write the true maps of the workspace, see ``list_workspace_files``, into the folder ``part``."""
    extent = find_workspace_extent(built.settings.workspace)
    maps = {WORKSPACE_FILE: make_heights(rays, extent)}
    if built.settings.workspace.materials:
        with open_render_scene(built, frame) as scene:  # a separate scene, so that the pair's scene stays unchanged
            maps[MATERIALS_FILE] = make_materials(built, scene, part, extent)
    for name, values in maps.items():
        with explain_disk_errors("write", part / name), (part / name).open("wb") as stream:
            np.save(stream, values, allow_pickle=False)


def _render_radiance(
    scene: bpy.types.Scene, built: Built, lights: list[separate_lights.LightPass], stem: Path, planned: PlannedPair
) -> dict[str, Path]:
    """Render the radiance of a pair as ``_render_light`` does, with the truth that comes with it."""
    return _render_light(scene, built, lights, stem, planned, planned.settings.quality.truth)


def _render_light(
    scene: bpy.types.Scene,
    built: Built,
    lights: list[separate_lights.LightPass],
    stem: Path,
    planned: PlannedPair,
    truth: str,
) -> dict[str, Path]:
    """Render radiance into separate files, by eye. Lights that need separate renders are rendered one by one and
    summed. ``truth`` is the truth that comes with the radiance, see ``passes.choose_layer``."""
    files: dict[str, Path] = {}
    for number, light in enumerate(lights):
        made = passes.choose_layer(scene, BEAUTY, stem.with_name(f"{stem.name}-{number}"), truth)
        veiled = add_veil_temporarily(scene, planned.settings.veil, int(planned.settings.quality.diffuse_bounces))
        with separate_lights.use_light(built, light), veiled:
            _run_cycles(scene, made, planned)
        for eye, file in made.items():
            if eye in files:
                with explain_disk_errors("write", file), _report_unreadable(planned):
                    first, other = (read_pieces(each.read_bytes()) for each in (files[eye], file))
                    files[eye].write_bytes(assemble(add_group(first, other, light.group or "")))
                    system.remove(file)
            files.setdefault(eye, file)
    return files


def _render_truth(
    scene: bpy.types.Scene, built: Built, stem: Path, planned: PlannedPair, camera: StereoCamera, toed: bool
) -> dict[str, Path]:
    """Render truth into separate files, by eye. For parallel eyes full truth includes the pixels that are hidden from
    the other eye."""
    files = passes.choose_layer(scene, TRUTH, stem, planned.settings.quality.truth)
    between: dict[str, list[Array]] = {eye: [] for eye in files}
    with separate_lights.disable_osl(scene), truth_without_light.switch_lights_off(scene):
        _run_cycles(scene, files, planned)
        if toed or not _has_full_truth(planned):
            return files
        with _render_depth_alone(scene, built):
            shifted = passes.choose_layer(scene, TRUTH, stem.with_name(f"{stem.name}-between"), "DEPTH")
            for step in cycles_occlusion.STEPS_PX:
                with shift_frame(scene, step):
                    _run_cycles(scene, shifted, planned)
                with explain_disk_errors("write", stem), _report_unreadable(planned):
                    for eye, file in shifted.items():
                        # In single precision: millions of pixels have four numbers each here.
                        between[eye].append(
                            cycles_occlusion.read_disparity(file.read_bytes(), camera).astype(np.float32)
                        )
                        system.remove(file)
    with explain_disk_errors("write", stem), _report_unreadable(planned):
        cycles_occlusion.add_hidden_pass(files, between, camera)
    return files


@contextmanager
def _render_depth_alone(scene: bpy.types.Scene, built: Built) -> Iterator[None]:
    """Prepare the render of a depth that is read once and removed: without surfaces, where this saves time."""
    pixels = scene.render.resolution_x * scene.render.resolution_y
    kept = scene.render.use_persistent_data
    too_many = kept and _count_triangles(built) > truth_without_light.MAX_TRIANGLES_PER_PIXEL * pixels
    with truth_without_light.remove_surfaces([] if too_many else built.materials):
        yield


@contextmanager
def _report_unreadable(planned: PlannedPair) -> Iterator[None]:
    """Raise IcyMoonError if an image of Blender cannot be read."""
    try:
        yield
    except (ValueError, KeyError, OverBudgetError) as error:
        raise IcyMoonError(
            f"The images that Blender wrote for pair {planned.id} cannot be joined ({error}); render the pair again."
        ) from None


def _run_cycles(scene: bpy.types.Scene, files: dict[str, Path], planned: PlannedPair) -> None:
    """Let Cycles render into these files. Raises IcyMoonError if it fails, DiskError for incomplete files."""
    try:
        bpy.ops.render.render(write_still=True, scene=scene.name)
    except RuntimeError as error:
        raise IcyMoonError(f"Cycles could not render pair {planned.id}: {find_first_line(error)}") from None
    for file in files.values():
        if not is_whole(file):
            raise DiskError(
                f"Blender could not write the whole image of pair {planned.id} to {file.parent.parent}; "
                "the disk is full or the folder may not be written to."
            )


def _read_layers(written: dict[str, Path], final: Path) -> dict[str, list[Piece]]:
    """Read the parts of the layers that were written for the file ``final``, and remove their files."""
    with explain_disk_errors("write", final):
        found = {name: read_pieces(file.read_bytes()) for name, file in written.items()}
        for file in written.values():
            system.remove(file)
    return found


def _write_layers(
    layers: dict[str, list[Piece]], final: Path, rounded: set[str], compact: bool, unwanted: set[str]
) -> dict[str, Any]:
    """Put layers into one file, flush it and return its size and checksum.

    The passes ``rounded`` are stored as 16-bit floats, and the passes ``unwanted`` are left out. A ``compact`` file has
    no image that is the sum of its lights.
    """
    twice = {IMAGE_PASS} if compact and BEAUTY in layers and is_sum_of_lights(layers[BEAUTY]) else set[str]()

    def reduce(piece: Piece) -> Piece | None:
        kept = drop_passes(piece, passes.UNWANTED_PASSES | twice | unwanted)
        return kept and compress(round_passes(kept, rounded))

    data = join_layers(layers, reduce)
    with explain_disk_errors("write", final):
        final.write_bytes(data)
        system.flush(final)
    return _describe_file(final)


def _describe_file(file: Path) -> dict[str, Any]:
    """Return the size and the checksum of a file of a pair."""
    return {"bytes": file.stat().st_size, "sha256": hash_file(file)}
