"""The sketch of a mechanism on a page: places on the sheet are those of the points in space, at every instant."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from consilience.case import load_case
from consilience.mechanism import State, centres_of_mass
from consilience.report.sketch import SIZE, sketch

SVG = "{http://www.w3.org/2000/svg}"


def _places(text):
    return np.array([[float(x) for x in place.split(",")] for place in text.split()])


def _centres(drawn):
    groups = ET.fromstring(drawn.strip()).iter(f"{SVG}g")
    texts = [g.get("transform")[len("translate(") : -1] for g in groups if g.get("fill") == "currentColor"]
    return _places(" ".join(texts))


@pytest.mark.parametrize("name", ["four_bar", "stewart_platform", "chain_of_100"])
def test_a_sketch_is_on_its_sheet_and_has_a_centre_for_each_body(name):
    case = load_case(name)
    drawn = sketch(case.mechanism, [case.initial_state], case.title)
    centres = _centres(drawn)
    lines = np.vstack([_places(line.get("points")) for line in ET.fromstring(drawn.strip()).iter(f"{SVG}polyline")])
    assert len(centres) == len(case.mechanism.bodies)
    for places in (centres, lines):
        assert np.all(places >= 0)
        assert np.all(places <= np.array(SIZE))


def test_a_flat_mechanism_keeps_its_proportions_and_its_upward():
    case = load_case("four_bar")  # in the plane x-z, gravity along -z
    centres = _centres(sketch(case.mechanism, [case.initial_state], case.title))
    space = centres_of_mass(case.mechanism, case.initial_state)[0][:, [0, 2]]
    moved, seen = space[1:] - space[0], (centres[1:] - centres[0]) * [1.0, -1.0]
    scale = np.linalg.norm(seen) / np.linalg.norm(moved)
    assert np.allclose(seen, scale * moved, atol=0.2)  # printed to a tenth of a pixel


def test_a_moving_sketch_passes_through_every_state():
    case = load_case("double_pendulum")
    start = case.initial_state
    later = State(start.p_WB + np.array([0.0, 0.0, 0.5]), start.quat_WB, start.v_WB_W, start.w_WB_W)
    drawn = sketch(case.mechanism, [start, later], case.title, duration=1.0)
    values = next(ET.fromstring(drawn.strip()).iter(f"{SVG}animate")).get("values").split(";")
    assert len(values) == 2
    rise = _places(values[0]) - _places(values[1])
    assert np.all(np.abs(rise[:, 0]) < 0.2)
    assert np.all(rise[:, 1] > 1.0)  # upward on the sheet is a smaller ordinate
