"""The sentences before the tables: on search ranges and on the noise of renders."""

import pytest
from icymoon.stereo.images.disparity_and_occlusion import ESTIMATED
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.render_noise import BAKE, CLEAN, DECIDES, NOISY, RENDER, UNKNOWN
from icymoon.stereo.report.notes import BAKED, NOISE, SEARCH, Notes
from icymoon.support.file_schemas import find_fault


def sentences(text, *searches):
    methods = parse_methods(text)
    notes = Notes(methods)
    for k, search in enumerate(searches):
        assert not find_fault({"search": search}, {"search": SEARCH})
        notes.add({"pair": f"p{k}", "method": methods[0].label, "search": search, "options": {}})
    return [note.sentence for note in notes.found()]


def with_noise(*verdicts):
    notes = Notes(parse_methods("bm"))
    for verdict, doubt in verdicts:
        part = {"share": 0.5, "noise_dn": 3.0, "hidden": 0.1}
        facts = {"noise": {"verdict": verdict, "lit": part, "shadow": part, "doubt": doubt}}
        assert not find_fault(facts, {"noise": NOISE})
        notes.add_pair(facts)
    notes.add_pair({})  # photographs, which no one has rendered
    return [note.sentence for note in notes.found()]


def test_what_noise_decides_is_said_with_the_difference_that_it_hides():
    decided, noisy = with_noise((DECIDES, 0.12), (CLEAN, 0.001), (NOISY, 0.02), (DECIDES, 0.21), (None, None))
    assert "decides the result in 2 of 6 pairs" in decided
    assert "less than 21 % of the pixels" in decided
    assert "may differ by noise alone; raise quality.samples" in decided
    assert noisy.startswith("The render is noisy in 1 of 6 pairs:")
    assert not with_noise((CLEAN, 0.001))


def test_a_mean_is_in_doubt_by_the_mean_of_the_pairs_doubts():
    """A noisy pair among many clean ones changes their mean by little."""
    notes = Notes(parse_methods("bm"))
    assert notes.noise_doubt == 0
    part = {"share": 0.5, "noise_dn": 3.0, "hidden": 0.1}
    for verdict, doubt in ((DECIDES, 0.12), (DECIDES, 0.2), (NOISY, 0.02), (CLEAN, 0.001)):
        notes.add_pair({"noise": {"verdict": verdict, "lit": part, "shadow": part, "doubt": doubt}})
    assert notes.noise_doubt == pytest.approx((0.12 + 0.2) / 4)


def test_only_what_makes_results_doubtful_is_a_doubt():
    part = {"share": 0.5, "noise_dn": 3.0, "hidden": 0.1}
    baked = {"noise": 0.02, "share": 0.3, "bound": 0.05}
    for facts, doubtful in (
        ({"noise": {"verdict": DECIDES, "lit": part, "shadow": part, "doubt": 0.2}}, True),
        ({"noise": {"verdict": NOISY, "lit": part, "shadow": part, "doubt": 0.2}}, False),
        ({"occlusion": ESTIMATED}, False),
        ({"baked": baked}, False),
        ({"baked": baked | {"bound": 0.01}}, True),
    ):
        notes = Notes(parse_methods("bm"))
        notes.add_pair(facts)
        assert [note.doubtful for note in notes.found()] == [doubtful], facts


def test_photographs_are_not_told_how_to_render():
    for added, rendered in (([{"layout": "GUISS"}], False), ([{}], True), ([{"layout": "KITTI 2015"}, {}], True)):
        notes = Notes(parse_methods("bm"))
        for facts in added:
            notes.add_pair(facts | {"occlusion": ESTIMATED})
        (sentence,) = (note.sentence for note in notes.found())
        assert sentence.startswith(f"Hidden pixels are estimated in {len(added)} of")
        assert ("quality.truth" in sentence) == rendered


def test_of_one_pair_no_number_is_stated():
    for verdict, words in ((DECIDES, "Noise of the render decides the result: "), (NOISY, "The render is noisy: ")):
        notes = Notes(parse_methods("bm"))
        part = {"share": 0.5, "noise_dn": 3.0, "hidden": 0.1}
        notes.add_pair({"noise": {"verdict": verdict, "lit": part, "shadow": part, "doubt": 0.2}})
        (sentence,) = (note.sentence for note in notes.found())
        assert sentence.startswith(words)


def search(missed, source="rig", most=95):
    return {"least_px": 0, "most_px": most, "source": source, "missed": missed}


@pytest.mark.parametrize(
    ("source", "fix"),
    [("stated", "Leave the option out"), ("rig", "State a larger range"), ("fixed", "Nothing is known of the rig")],
)
def test_a_range_that_misses_disparities_is_said_with_the_fix(source, fix):
    (said,) = sentences(
        "bm", search(0.3, source, 31), search(0.005, source), search(0.02, source), search(None, source)
    )
    assert "in 2 of 4 pairs" in said
    assert "at most 30 % (pair p0, searched 0 to 31 px)" in said
    assert fix in said


def test_nothing_is_said_without_a_reason():
    assert not sentences("bm", search(0.01), search(0.0), None)


def test_a_range_from_truth_is_said():
    (said,) = sentences("bm:disparities=truth", search(0.0, "truth"))
    assert "range from truth" in said


def test_a_brief_note_names_the_whole_method():
    """Its label may contain a colon."""
    notes = Notes(parse_methods("bm:window=21"))
    notes.add({"pair": "p", "method": "bm:window=21", "search": search(0.3), "options": {}})
    (note,) = notes.found()
    assert note.brief == "StereoBM window=21 cannot measure everything"
    assert note.sentence == f"{note.brief}: {note.detail}"


def with_baked(*numbers, bound=0.01):
    notes = Notes(parse_methods("bm"))
    for noise, share in numbers:
        facts = {"baked": {"noise": noise, "share": share, "bound": bound}}
        assert not find_fault(facts, {"baked": BAKED})
        notes.add_pair(facts)
    notes.add_pair({"baked": None})
    return [note.sentence for note in notes.found()]


def test_noise_of_baked_light_is_stated_with_the_fix_where_it_is_above_its_bound():
    (said,) = with_baked((0.004, 0.2), (0.033, 0.79))
    assert said.startswith("Indirect light is baked in 2 of 3 pairs")
    assert "at most 3.3 % of the light, in a pair of which 79 % is indirect" in said
    assert "In 1 of them it is above quality.bake_noise" in said
    (within,) = with_baked((0.004, 0.2))
    assert "above" not in within
    (any_noise,) = with_baked((0.27, 0.999), bound=0.0)
    assert "at most 27 % of the light, in a pair of which 100 % is indirect" in any_noise
    assert "above" not in any_noise
    assert not with_baked()


def by(*noises):
    notes = Notes(parse_methods("bm"))
    for verdict, larger in noises:
        part = {"share": 0.5, "noise_dn": 3.0, "hidden": 0.1, "baked_dn": None, "by_bake": 0.7}
        facts = {"noise": {"verdict": verdict, "larger": larger, "lit": part, "shadow": part, "doubt": 0.2}}
        assert not find_fault(facts, {"noise": NOISE})
        notes.add_pair(facts)
    return notes.found()


def test_noise_of_baked_light_that_decides_is_said_with_its_own_fix():
    (said,) = by((DECIDES, BAKE))
    assert said.doubtful
    assert "raise quality.bake_samples and look" in said.detail
    assert said.detail.endswith(
        "Most of it is noise of baked light, which is fixed to the ground: matchers take it "
        "for texture and look better than they are."
    )
    (said,) = by((DECIDES, BAKE), (DECIDES, RENDER), (DECIDES, RENDER))
    assert "raise quality.bake_samples and quality.samples and look" in said.detail
    assert "In 1 pair of these most of it is noise of baked light" in said.detail
    (said,) = by((DECIDES, RENDER))
    assert "raise quality.samples and look" in said.detail
    assert "baked" not in said.detail
    assert ["noise of baked light" in note.detail for note in by((NOISY, BAKE))] == [True]
    assert ["noise of baked light" in note.detail for note in by((NOISY, RENDER))] == [False]


def test_noise_of_baked_light_that_is_not_known_is_a_doubt():
    (said,) = by((UNKNOWN, None), (CLEAN, None))
    assert said.doubtful
    assert said.brief == "The noise of baked light is unknown in 1 of 2 pairs"
    assert "render these pairs again into another data set" in said.detail
