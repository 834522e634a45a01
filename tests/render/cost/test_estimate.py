"""What a plan is expected to take: in proportion, additive, and corrected by what was measured."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.render.cost import estimate
from icymoon.render.plans.baked_or_traced import estimate_bake_seconds, estimate_light_bytes
from icymoon.render.plans.planned_pair import PlannedPair, expand_headings
from icymoon.render.plans.render_order import cut_into_jobs, order_pairs
from icymoon.render.plans.triangle_count import count_triangles
from icymoon.settings import description
from icymoon.settings.topics.declaration import Parts
from icymoon.settings.topics.scene import Settings

SMALL: Parts = {"terrain": {"resolution": 129}, "mesh": {"kind": "GRID"}, "rig": {"width_px": 64, "height_px": 48}}


def described(*changes: dict) -> Settings:
    return description.merged(description.defaults(), SMALL, *(description.check(c, "test") for c in changes))


def pairs_of(*settings):
    return [pair for each in settings for pair in expand_headings(each)]


def finish(dataset, pair, seconds, size=1000):
    """A pair that is there and says that it took so long, with one thread."""
    folder = pair.folder(dataset)
    folder.mkdir(parents=True)
    for eye in ("left.exr", "right.exr"):
        (folder / eye).write_bytes(bytes(int(size)))
    settings = description.merged(pair.settings, {"quality": {"threads": 1}})
    (folder / "pair.json").write_text(
        json.dumps(
            {
                "format": "icymoon-pair",
                "version": 1,
                "id": pair.id,
                "settings": settings,
                "camera": StereoCamera.from_settings(settings.rig).to_json(),
                "seconds": {"render": seconds, "write": 0.0, "build": 0.0},
                "files": {f"{eye}.exr": {"bytes": int(size), "sha256": "0" * 64} for eye in ("left", "right")},
            }
        )
    )


@pytest.mark.parametrize(
    ("change", "dearer"),
    [
        ({"quality": {"samples": 64}}, True),
        ({"rig": {"width_px": 640}}, True),
        ({"quality": {"denoiser": "OIDN"}}, True),
        ({"surface": {"subsurface_weight": 0.5, "subsurface_radius_m": 0.1}}, True),
        ({"surface": {"model": "LAMBERT"}}, False),
        ({"rocks": {"coverage": 0.1}}, True),
        ({"textures": {"set": "FROST"}}, True),
        ({"surface": {"model": "HAPKE"}}, True),
        ({"quality": {"truth": "DEPTH"}}, False),
        ({"surface": {"model": "LUNAR_LAMBERT"}, "light": {"lamps": [{}, {}]}}, True),
    ],
)
def test_what_costs_more_is_expected_to(change, dearer):
    base, other = (estimate.estimate_work(described(*c)).seconds(1e5) for c in ((), (change,)))
    assert (other > base) == dearer


def test_each_lamp_adds_its_light_group_to_the_files():
    none, one, two = (estimate.estimate_bytes(described({"light": {"lamps": [{}] * k}})) for k in range(3))
    assert two - one == pytest.approx(one - none, rel=0.5)
    assert none < one < two


SNOW = {"surface": {"subsurface_weight": 0.8, "subsurface_radius_m": 1.0e-3}}


@given(
    st.builds(
        dict,
        surface=st.fixed_dictionaries(
            {
                "model": st.sampled_from(["LAMBERT", "PRINCIPLED", "HAPKE", "LUNAR_LAMBERT"]),
                "subsurface_weight": st.sampled_from([0.0, 0.3, 1.0]),
                "subsurface_radius_m": st.sampled_from([1e-5, 1e-2, 1.0]),
                "relief": st.sampled_from(["BUMP", "DISPLACEMENT"]),
                "grain_amplitude_m": st.sampled_from([0.0, 0.004]),
            }
        ),
        rocks=st.fixed_dictionaries({"coverage": st.sampled_from([0.0, 0.1]), "own_surface": st.booleans()}),
        quality=st.fixed_dictionaries({"samples": st.integers(1, 512), "walk_px": st.sampled_from([0.0, 0.1, 100.0])}),
    )
)
def test_what_is_left_out_never_costs(scene):
    """More left out is never expected to take longer, and what is never seen is expected to cost as if it were off."""

    def seconds(*changes):
        return estimate.estimate_work(described(scene, *changes)).seconds(1e5)

    full = seconds()
    for lean in ({"fine_relief": "CAMERA"}, {"walk_px": 100.0}, {"truth": "DEPTH"}):
        assert seconds({"quality": lean}) <= full
    assert seconds({"surface": {"grain_amplitude_m": 0.0}}) <= full
    assert seconds({"surface": {"subsurface_weight": 0.0}}) <= full


@pytest.mark.parametrize(
    ("off", "never_on"),
    [
        # A mean free path far under a pixel is not walked, as if there were none.
        (SNOW, {"surface": {"subsurface_weight": 0.0}}),
        # Relief that is not there is left to nobody.
        (
            {"surface": {"grain_amplitude_m": 0.0}, "quality": {"fine_relief": "CAMERA"}},
            {"surface": {"grain_amplitude_m": 0.0}},
        ),
        # Hapke's law shades relief for all light.
        ({"surface": {"model": "HAPKE"}, "quality": {"fine_relief": "CAMERA"}}, {"surface": {"model": "HAPKE"}}),
    ],
)
def test_off_costs_what_never_on_does(off, never_on):
    assert estimate.estimate_work(described(off)) == estimate.estimate_work(described(never_on))


def test_a_walk_costs_where_it_is_walked():
    out, walked = (estimate.estimate_work(described(SNOW, {"quality": {"walk_px": limit}})) for limit in (0.1, 0.0))
    # 8.0 samples of Lambert's law more in python benchmarks plan_cost at weight 1, so more than 4 at any large weight.
    assert walked.relative - out.relative > 4


def test_samples_and_pixels_count_in_proportion():
    """Once what a pair costs anyhow is taken off, twice the samples or pixels cost twice as much."""

    def of(samples, width):
        return estimate.estimate_work(described({"quality": {"samples": samples}, "rig": {"width_px": width}})).seconds(
            0.0
        )

    per_sample = of(11, 64) - of(10, 64)
    assert of(40, 64) - of(20, 64) == pytest.approx(20 * per_sample)
    assert of(11, 128) - of(10, 128) == pytest.approx(2 * per_sample)


@pytest.mark.parametrize(("overscan", "pixels"), [(0.0, 2 * 64 * 48), (0.25, 2 * 96 * 72)])
def test_the_pixels_of_a_pair_are_those_of_both_eyes_with_their_margins(overscan, pixels):
    assert estimate.count_pixels(described({"rig": {"overscan": overscan}})) == pixels


@pytest.fixture(autouse=True)
def two_processors(monkeypatch):
    """A machine of one worker, whatever this one has."""
    for module in (
        "icymoon.render.plans.render_order",
        "icymoon.render.cost.estimate",
        "icymoon.render.cost.machine_speed",
    ):
        monkeypatch.setattr(f"{module}.count_processors", lambda: 2)


def test_a_scene_is_built_once_for_all_pairs_of_a_job():
    one = described()
    others = [described({"light": {"sun_elevation_deg": e}}) for e in (10.0, 20.0, 30.0)]
    grounds = [described({"terrain": {"hurst": h}}) for h in (0.5, 0.6, 0.7)]
    single, lights, terrains = (estimate.estimate_plan(pairs_of(*s)) for s in ([one], others, grounds))
    assert (lights.scenes, lights.geometries, lights.lights, lights.surfaces) == (1, 1, 3, 1)
    assert (terrains.scenes, terrains.geometries, terrains.lights, terrains.surfaces) == (3, 3, 1, 1)
    # A worker's job ends with two pairs, so the second job builds the ground again.
    triangles = 2.0 * 128**2
    a_pair = estimate.estimate_work(one).seconds(triangles)
    a_job = [cut_into_jobs(order_pairs(pairs_of(*s)), 1, 50) for s in (others, grounds)]
    assert [len(jobs) for jobs in a_job] == [2, 3]
    again = lights.seconds - single.seconds - 2 * a_pair  # another worker and its build
    assert again > estimate.build_seconds(one, triangles)
    assert terrains.seconds - lights.seconds == pytest.approx(again)


def test_a_start_counts_for_each_worker_that_the_jobs_need():
    """Jobs are cut so that workers end together: a worker of two processors has four."""
    headings = [pairs_of(described({"dataset": {"headings": n}})) for n in (1, 2, 64)]
    each = estimate.estimate_work(described()).seconds(2.0 * 128**2)
    one, two, many = (estimate.estimate_plan(pairs).seconds for pairs in headings)
    assert two - one == pytest.approx(each)  # the same worker
    jobs = len(cut_into_jobs(order_pairs(headings[2]), 1, 50))
    assert jobs > 1
    # To start Blender takes more than a second of a processor.
    starts = many - one - 63 * each - (jobs - 1) * estimate.build_seconds(described(), 2.0 * 128**2)
    assert starts / (jobs - 1) > 1.0


def test_ground_from_a_file_takes_longer_to_build():
    made_up, from_file = described(), described({"source": {"kind": "STAND_IN"}})
    assert estimate.build_seconds(from_file, 1e5) > estimate.build_seconds(made_up, 1e5) + 1.0


def test_the_triangles_are_those_of_the_ground():
    assert count_triangles(described()) == 2 * 128**2
    graded = described({"mesh": {"kind": "GRADED", "error_px": 4, "edge_px": 24}})
    from icymoon.physics.mesh.graded_mesh import grade_ground as make
    from icymoon.physics.terrain.terrain import make_terrain

    faces = make(make_terrain(graded, 1), graded).mesh()[1]
    # Euler: of a disc, as many triangles as twice the vertices but for those on its rim.
    assert count_triangles(graded) == pytest.approx(len(faces), rel=0.05)


def test_before_anything_is_rendered_another_machine_is_allowed_for():
    found = estimate.estimate_plan(pairs_of(described()))
    assert found.measured == 0
    assert found.factor == pytest.approx(3.0)
    assert "another machine" in "".join(found.lines())


def test_bytes_are_in_proportion_to_what_is_written():
    """Laws that hold whatever the coefficients are; ``tests/render/test_disk.py`` holds them against pairs."""

    def size(*changes):
        return estimate.estimate_bytes(described({"rig": {"pitch_deg": 85.0}}, *changes))

    base = size()
    finer = {"terrain": {"resolution": 257}}  # as many pixels for a facet
    doubled = size({"rig": {"width_px": 128, "height_px": 96}}, finer)
    assert 3.8 < doubled / base < 4.0  # neighbours are a little more alike
    assert base < size(finer)  # normals of facets are the same on all their pixels
    assert size({"rig": {"overscan": 0.25}}) == pytest.approx(base * 1.5**2, rel=1e-3)
    depth, toed = size({"quality": {"truth": "DEPTH"}}), size({"rig": {"toe_in_deg": 1.0}})
    assert depth < 0.7 * base
    assert base < 0.8 * size({"quality": {"files": "FULL"}})
    planet, full = {"light": {"planet": True}}, {"quality": {"files": "FULL"}}
    # The image beside its lights is in full files only, unless it was denoised.
    assert size(planet) - base < size(planet, full) - size(full)
    denoised = {"quality": {"denoiser": "OIDN"}}
    assert size(planet, denoised) - size(denoised) > size(planet) - base
    assert base < toed < 2.0 * base  # another truth, no other light
    assert size({"quality": {"denoiser": "OIDN"}}) > base
    assert size({"light": {"planet": True}}) == size({"light": {"stars": True}}) > base
    samples = [size({"quality": {"samples": n}}) for n in (1, 4, 16, 64, 1024)]
    assert samples == sorted(samples)
    assert samples[-1] == samples[-2]  # a value has no more digits than it has


@pytest.mark.parametrize(
    ("pitch_deg", "share"),
    [
        # The rows above the horizon of a lens of f = 85.33 px at 160 x 120: 60 - 85.33 tan(pitch) of 120.
        (0.0, 0.5),
        (10.0, 0.3746),
        (-20.0, 0.7588),
        (45.0, 0.0),
        (-60.0, 1.0),
    ],
)
def test_the_share_of_sky_is_that_of_a_level_ground(pitch_deg, share):
    view = {"rig": {"width_px": 160, "height_px": 120, "pitch_deg": pitch_deg}, "mesh": {"kind": "GRADED"}}
    assert estimate.compute_sky_fraction(described(view)) == pytest.approx(share, abs=1e-3)
    patch = estimate.compute_sky_fraction(described(view, {"mesh": {"kind": "GRID"}}))
    assert patch > share or share in (0.0, 1.0)


def test_bytes_that_are_left_are_those_of_the_pairs_that_are_not_there(tmp_path):
    pairs = pairs_of(*(described({"light": {"sun_elevation_deg": float(e)}}) for e in range(1, 5)))
    each, stated = estimate.estimate_bytes(pairs[0].settings), estimate.STATED_BYTES
    assert estimate.estimate_remaining_bytes(pairs, tmp_path) == pytest.approx(4 * (each + stated))
    for pair in pairs[:3]:
        finish(tmp_path, pair, 1.0, size=each)  # twice what is expected, in two files
    assert estimate.estimate_remaining_bytes(pairs, tmp_path) == pytest.approx(2 * each + stated, rel=1e-3)
    assert estimate.estimate_remaining_bytes(pairs, tmp_path, again=True) == pytest.approx(
        8 * each + 4 * stated, rel=1e-3
    )
    assert estimate.estimate_plan(pairs, tmp_path).left_bytes == estimate.estimate_remaining_bytes(pairs, tmp_path)


def test_what_is_there_is_learnt_from_and_taken_off(tmp_path):
    pairs = pairs_of(*(described({"light": {"sun_elevation_deg": float(e)}}) for e in range(1, 31)))
    blind = estimate.estimate_plan(pairs, tmp_path)
    expected = estimate.estimate_work(pairs[0].settings)
    for pair in pairs[:20]:
        finish(
            tmp_path, pair, 7.0 * expected.seconds(2.0 * 128**2), size=5 * estimate.estimate_bytes(pair.settings) / 2
        )
    found = estimate.estimate_plan(pairs, tmp_path)
    assert (found.pairs, found.there, found.measured) == (30, 20, 20)
    # Twenty pairs outweigh what was known before: log(7) is met within a twentieth.
    assert found.seconds / blind.seconds == pytest.approx(7.0, rel=0.1)
    assert found.factor < 1.2 < blind.factor
    # Ten pairs of thirty are left: a third, but for the scene and the start, which are paid again.
    assert 0.3 < found.left_s / found.seconds < 0.7
    assert found.left_bytes == pytest.approx(
        10 * (5 * estimate.estimate_bytes(pairs[0].settings) + estimate.STATED_BYTES), rel=1e-4
    )
    assert "20 already rendered" in found.lines()[0]
    assert "corrected by 20" in "".join(found.lines())


def test_more_pairs_make_it_surer(tmp_path):
    pairs = pairs_of(*(described({"light": {"sun_elevation_deg": float(e)}}) for e in range(1, 10)))
    factors = [estimate.estimate_plan(pairs, tmp_path).factor]
    for pair in pairs[:4]:
        finish(tmp_path, pair, 1.0)
        factors.append(estimate.estimate_plan(pairs, tmp_path).factor)
    assert factors == sorted(factors, reverse=True)


def test_a_broken_pair_teaches_nothing(tmp_path):
    pairs = pairs_of(described())
    finish(tmp_path, pairs[0], 1.0)
    (pairs[0].folder(tmp_path) / "pair.json").write_text("{")
    assert estimate.estimate_plan(pairs, tmp_path).measured == 0


def test_a_done_data_set_takes_nothing(tmp_path):
    pairs = pairs_of(described())
    finish(tmp_path, pairs[0], 1.0)
    found = estimate.estimate_plan(pairs, tmp_path)
    assert (found.left_s, found.left_bytes) == (0.0, 0.0)
    assert len(found.lines()) == 2


def test_a_mesh_that_cannot_be_counted_is_left_to_the_build(tmp_path):
    settings = described({"source": {"kind": "MESH", "file": str(tmp_path / "absent.ply")}})
    assert estimate.estimate_plan([PlannedPair("0" * 12, settings, 0.0)]).pairs == 1


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(3.2, "3.2 s"), (99, "99 s"), (120, "2 min"), (5400, "90 min"), (20000, "5.6 h"), (259200, "3 days")],
)
def test_durations_are_legible(seconds, text):
    assert estimate.format_duration(seconds) == text


def test_sizes_are_legible():
    assert (estimate.format_size(12.34e6), estimate.format_size(3.4567e9)) == ("12.3 MB", "3.46 GB")


def test_a_noise_threshold_saves_samples_beyond_the_least_that_cycles_takes():
    """Cycles takes 16 t^-0.3 samples at least (a count of the samples of renders, see python benchmarks plan_cost)."""
    assert estimate.estimate_mean_samples(16, 0.01) == 16
    assert estimate.estimate_mean_samples(256, 0.0) == 256
    assert estimate.estimate_mean_samples(256, 0.1) == pytest.approx(32, abs=1)
    taken = [estimate.estimate_mean_samples(256, limit) for limit in (0.3, 0.1, 0.05, 0.02, 0.005)]
    assert taken == sorted(taken)
    assert taken[-1] == 256
    few, all_of_them = (described({"quality": {"samples": 256, "noise_threshold": t}}) for t in (0.1, 0.0))
    assert estimate.estimate_work(few).seconds(0.0) < estimate.estimate_work(all_of_them).seconds(0.0) / 4


def test_baked_light_is_counted_once_for_all_pairs_that_share_it():
    baked = {"surface": {"model": "LAMBERT"}, "quality": {"indirect": "BAKED"}, "dataset": {"headings": 4}}

    def expected(area, resolution):
        made = described(baked, {"quality": {"bake_area": area}}, {"terrain": {"resolution": resolution}})
        return estimate.estimate_plan(pairs_of(made))

    several, more, each, finer = (expected(area, n) for area in ("GROUND", "VIEW") for n in (129, 257))
    # The file has light for each vertex, of the whole ground or of what each of four headings sees.
    of_a_vertex = (more.left_bytes - several.left_bytes) / (257**2 - 129**2)
    assert of_a_vertex == pytest.approx(estimate_light_bytes(described(baked)) / 129**2, rel=0.05)
    assert 4 * 0.1 < (finer.left_bytes - each.left_bytes) / (more.left_bytes - several.left_bytes) < 4 * 0.4
    seen = described(baked, {"quality": {"bake_area": "VIEW"}})
    assert each.seconds - several.seconds == pytest.approx(
        4 * estimate_bake_seconds(seen) - estimate_bake_seconds(described(baked)), rel=0.05
    )


def test_images_cost_less_where_lamberts_law_reads_some_of_them():
    images, own = {"textures": {"set": "FROST"}}, {"textures": {"set": "MESH"}}
    lambert = {"surface": {"model": "LAMBERT"}}

    def relative(*changes):
        return estimate.estimate_work(described(*changes)).relative

    assert relative(images) - relative() > 3 * (relative(images, lambert) - relative(lambert)) > 0
    assert relative(lambert) < relative(lambert, own) < relative(lambert, images)
    assert (
        estimate_bake_seconds(described(lambert, images))
        > estimate_bake_seconds(described(lambert, own))
        > (estimate_bake_seconds(described(lambert)))
    )
