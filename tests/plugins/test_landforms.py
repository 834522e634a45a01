"""What the landform of a plug-in declares, and what is refused."""

import numpy as np
import pytest
from icymoon.plugins.installed import find_installed
from icymoon.plugins.landforms import hash_name, read_landform
from icymoon.support.errors import IcyMoonError
from plugin_packages import LANDFORM, add_package


@pytest.fixture
def read(tmp_path, monkeypatch):
    def run(source):
        add_package(tmp_path / str(len(list(tmp_path.iterdir()))), monkeypatch, "landform", "steps", source)
        return read_landform(find_installed("landform", ()).usable["steps"])

    return run


def test_what_it_declares(read):
    landform = read(LANDFORM)
    assert (landform.topic, landform.label, landform.doc) == ("landform_steps", "Steps", "Steps of ice")
    assert [(n.key, n.unit, n.default, n.maximum) for n in landform.settings] == [
        ("height_m", "m", 0.0, 5.0),
        ("count", "1", 3, 9),
    ]
    told = landform.make_plugin_settings({"height_m": 2.0, "count": 4, "made_by": "x"}, 7)
    assert dict(told) == {"height_m": 2.0, "count": 4, "seed": 7}
    x = np.array([[-1.0, 1.0]])
    np.testing.assert_array_equal(landform.heights(x, np.zeros((3, 1)), told), [[0.0, 2.0]] * 3)
    assert landform.finest_m(told) == 0.5


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("SETTINGS = {", "SETTINGS = {}\nX = {", "has no SETTINGS; write SETTINGS = "),
        ("SETTINGS = {", "SETTINGS = [1]\nX = {", "has no SETTINGS"),
        ('"default": 0.0', '"default": 1.0', "0 turns it off; give it the default 0"),
        ('"minimum": 0.0', '"minimum": -1.0', "0 turns it off; give it the default 0"),
        ('"maximum": 5.0', '"maximum": 0.0', "give three numbers"),
        ('"maximum": 5.0', '"maximum": float("inf")', "give three numbers"),
        ('"maximum": 5.0', '"maximum": "x"', "give three numbers"),
        ('"maximum": 5.0, ', "", "has no maximum"),
        ('"maximum": 5.0', '"maximum": 5.0, "unit": "m"', "has 'unit'; a setting has default"),
        ('"label": "Height"', '"label": " "', "an empty label or doc"),
        ('"height_m":', '"Height":', "has a name that cannot be used"),
        ('"height_m":', '"made_by":', "has a name that"),
        ('"height_m":', '"seed":', "has a name that"),
        ("def height", "def hight", "has no function height"),
        ("ICYMOON_API = 1", "ICYMOON_API = 3", "states ICYMOON_API = 3"),
    ],
)
def test_a_bad_declaration_is_named(read, before, after, said):
    assert before in LANDFORM
    with pytest.raises(IcyMoonError, match=f"^The landform steps of the package icymoon-test-steps 1.0.*{said}"):
        read(LANDFORM.replace(before, after, 1))


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("return None", "returned NoneType for points"),
        ("return 1.0", "returned float for points"),
        ("return np.zeros(3)", r"returned float64 \(3,\) for points of the shape \(1, 2\)"),
        ("return np.zeros(x.shape, int)", r"returned int64 \(1, 2\)"),
        ("return x * np.nan", "returned 2 heights that are NaN or infinite"),
        ("return x / 0", "returned 2 heights that are NaN or infinite"),
        ("raise KeyError('spacing')", r"failed \(KeyError: 'spacing', plugin_of_a_test_\d+.py line"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_what_it_does_wrong_is_one_sentence(read, body, said):
    landform = read(LANDFORM.replace("return np.where(x > 0, settings['height_m'], 0.0)", body))
    with pytest.raises(IcyMoonError, match=said) as raised:
        landform.heights(np.array([[1.0, 2.0]]), np.zeros((1, 1)), {})
    assert "The landform steps of the package icymoon-test-steps 1.0" in str(raised.value)


def test_a_length_of_nothing_is_refused(read):
    landform = read(LANDFORM.replace("return 0.5", "return 0.0"))
    with pytest.raises(IcyMoonError, match="states a smallest length of 0 m; return more than 0"):
        landform.finest_m({})


def test_it_cannot_change_the_points_or_the_settings(read):
    landform = read(LANDFORM.replace("return np.where", "x[:] = 9; return np.where"))
    x = np.zeros(3)
    landform.heights(x, x, landform.make_plugin_settings({"height_m": 1.0, "count": 3}, 0))
    assert not x.any()
    landform = read(LANDFORM.replace("return np.where", "settings['count'] = 9; return np.where"))
    with pytest.raises(IcyMoonError, match="TypeError"):
        landform.heights(x, x, landform.make_plugin_settings({"height_m": 1.0, "count": 3}, 0))


def test_a_name_stands_for_the_same_number_for_ever():
    """Otherwise old pairs would have other ground."""
    assert hash_name("waves") == 3951147615
