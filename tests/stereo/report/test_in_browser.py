"""The report in a real browser, used by mouse and keys: sorting, switches, the address, and pictures that enlarge."""

import re
import shutil

import manyrows
import pairs
import pytest
from browser import PROGRAM, browser
from icymoon.stereo.matchers.methods import parse_methods

pytestmark = [pytest.mark.heavy, pytest.mark.skipif(shutil.which(PROGRAM) is None, reason="no browser")]

COUNT = 80
HEADINGS = "document.querySelectorAll('#ranking th button')"
FOCUSED = "document.activeElement.textContent || document.activeElement.getAttribute('aria-label')"
CAPTION = "document.getElementById('caption').textContent"
OPEN = "document.getElementById('enlarged').open"


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    root = tmp_path_factory.mktemp("report")
    manyrows.multiply(
        pairs.write_pair(root / "real", rig=pairs.camera(192, 96)), parse_methods("bm,sgbm"), COUNT, root / "out"
    )
    return (root / "out" / "report.html").as_uri()


@pytest.fixture(scope="module")
def program():
    with browser() as page:
        yield page


@pytest.fixture
def page(program, address):
    program.resize(1280, 900)
    program.open(address)
    yield program
    assert program.errors == []


def rows(page, region):
    """The text of each cell of the body of a table."""
    return page.value(
        f"[...document.querySelectorAll('#{region} tbody tr')].map("
        "row => [...row.cells].map(cell => cell.firstChild?.textContent ?? ''))"
    )


def numbers(page, column):
    return [float(row[column]) for row in rows(page, "ranking")]


def sorting(page):
    return page.value(f"[...{HEADINGS}].map(each => each.parentElement.getAttribute('aria-sort'))")


@pytest.mark.long
def test_every_heading_of_the_ranking_sorts_both_ways(page):
    for column in range(1, page.value(f"{HEADINGS}.length")):
        found = []
        for _ in range(2):
            page.click(f"{HEADINGS}[{column}]")
            state = sorting(page)
            assert [k for k, each in enumerate(state) if each] == [column]
            found.append((state[column], numbers(page, column)))
        assert {state for state, _ in found} == {"ascending", "descending"}
        for state, values in found:
            assert values == sorted(values, reverse=state == "descending")
        assert len(set(found[0][1])) == 2  # or the order would show nothing
    page.click(f"{HEADINGS}[0]")
    assert [row[0] for row in rows(page, "ranking")] == ["SGBM", "StereoBM"]


@pytest.mark.long
def test_the_address_keeps_view_condition_and_sorting(page, address):
    page.click("document.querySelector('input[value=visible]')")
    page.click(f"{HEADINGS}[2]")
    page.value(
        "(() => { const each = document.getElementById('condition'); each.selectedIndex = 2; "
        "each.dispatchEvent(new Event('change')); })()"
    )
    shown, there = rows(page, "ranking"), page.value("location.hash")
    assert re.search("pixels=visible.*condition=2.*sort=1", there)
    page.open(address)
    assert rows(page, "ranking") != shown
    page.open(address + there)
    assert rows(page, "ranking") == shown
    assert page.value("document.querySelector('input[value=visible]').checked")
    assert page.value("document.getElementById('condition').selectedIndex") == 2
    page.open(address + "#pixels=nonsense&condition=99&sort=77&down=x")
    assert len(rows(page, "ranking")) == 2


def test_keys_reach_and_sort_the_ranking_and_the_focus_is_seen(page):
    page.value("document.querySelector('input[name=view]').focus()")
    page.press("ArrowRight")
    assert page.value("document.querySelector('input[name=view]:checked').value") == "measured"
    for _ in range(30):
        page.press("Tab")
        if page.value(f"[...{HEADINGS}].indexOf(document.activeElement)") == 1:
            break
    before = sorting(page)
    page.press("Enter")
    assert sorting(page) != before
    assert page.value(f"[...{HEADINGS}].indexOf(document.activeElement)") == 1  # in the new table
    page.press(" ")
    assert page.value("parseFloat(getComputedStyle(document.activeElement).outlineWidth)") >= 2
    assert page.value("getComputedStyle(document.activeElement).outlineStyle") == "solid"


def test_a_picture_enlarges_steps_and_closes_by_mouse_and_keys(page):
    cell = "document.querySelectorAll('.matrix tbody tr')[0].cells[1].querySelector('button')"
    page.click(cell)
    assert page.value(OPEN)
    first = page.value(CAPTION)
    assert first.startswith("Left image, Ice: Albedo 0.2")
    assert page.value("document.getElementById('large').src.startsWith('data:')")
    page.press("ArrowRight")
    assert page.value(CAPTION).startswith("Error of StereoBM, Ice: Albedo 0.2")
    page.press("ArrowDown")
    assert page.value(CAPTION).startswith("Error of StereoBM, Ice: Albedo 0.4")
    page.press("ArrowUp")
    page.press("ArrowLeft")
    page.press("ArrowLeft")  # there is none before the first one
    page.press("ArrowUp")
    assert page.value(CAPTION) == first
    page.press("Escape")
    assert not page.value(OPEN)
    assert page.value(f"document.activeElement === {cell}")
    page.press("Enter")
    assert page.value(OPEN)
    page.click("document.getElementById('next')")
    page.click("document.getElementById('large')")
    assert not page.value(OPEN)
    assert page.value("document.activeElement.getAttribute('aria-label')").startswith("Enlarge: Error of StereoBM")
    page.click("document.querySelector('.pair .picture')")
    assert page.value(CAPTION).startswith("True depth, ")
    page.click("document.getElementById('close')")
    assert not page.value(OPEN)


def test_a_picture_of_the_folder_beside_the_report_has_all_pixels_and_one_that_is_missing_says_so(page):
    page.click("document.querySelectorAll('.matrix tbody tr')[0].cells[2].querySelector('button')")
    page.value("new Promise(done => setTimeout(done, 300))")
    assert page.value("document.getElementById('large').src").endswith("/bm_error.png")
    assert page.value("document.getElementById('large').naturalHeight") > 96  # with its scale
    page.press("Escape")
    page.click("document.querySelector('#all-pairs td button')")
    page.value("new Promise(done => setTimeout(done, 300))")
    assert "keep the folder" in page.value("document.getElementById('opened').textContent")


def test_the_table_of_pairs_is_filtered_sorted_and_turned(page):
    assert len(rows(page, "all-pairs")) == 25
    page.click("document.getElementById('after')")
    assert "page 2 of 4" in page.value("document.getElementById('page').textContent")
    page.value(
        "(() => { const each = document.getElementById('filter'); each.value = 'suspect'; "
        "each.dispatchEvent(new Event('input')); })()"
    )
    assert [row[2] for row in rows(page, "all-pairs")] == ["suspect"]


@pytest.mark.long
@pytest.mark.parametrize("width", [420, 1280])
def test_no_width_makes_the_page_wider_than_the_screen(page, width):
    page.resize(width, 900, dark=True)
    assert page.value("document.documentElement.scrollWidth") == width
    assert page.value("getComputedStyle(document.body).backgroundColor") == "rgb(16, 21, 27)"


@pytest.mark.long
def test_a_chart_alone_is_no_larger_than_beside_others(page):
    """Foreign pairs have one chart under Where it fails, for instance."""
    width = "document.querySelector('.charts svg').getBoundingClientRect().width"
    beside = page.value(width)
    page.value("[...document.querySelector('.charts').children].slice(1).forEach(each => each.remove())")
    assert page.value(width) == beside < 500
