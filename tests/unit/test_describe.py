"""The page of a case names every element that acts on its mechanism."""

import dataclasses
import re
import xml.etree.ElementTree as ET
from io import BytesIO
from itertools import pairwise

import numpy as np
import pytest

from consilience.case import Case, load_case, load_cases, shipped_cases
from consilience.case.families import family_cases
from consilience.errors import InvalidInput
from consilience.mechanism import Initial, Rolling, Skate, body_point, centres_of_mass
from consilience.report.figure import COLOURS
from consilience.report.figure3d import figure_of, upright, widest_view
from consilience.report.picture import as_png, picture, views
from consilience.report.summary import describe_case
from consilience.report.textdrawing import COLUMNS, ROWS, draw
from mechanisms import ELEMENTS, LOOPS, TREES, chain, states_of

GROUPS = (
    "joints",
    "springs",
    "joint_springs",
    "loads",
    "frictions",
    "controls",
    "drives",
    "couplings",
    "rollings",
    "skates",
)


@pytest.mark.parametrize("name", ELEMENTS)
def test_every_joint_and_element_has_a_line(name):
    mechanism = ELEMENTS[name]
    text = describe_case(
        Case(name, f"{name}.toml", "title", mechanism, Initial(), 1.0, 0.1, 8, 2, 1, ("here",), "", ())
    )
    for group in GROUPS:
        for element in getattr(mechanism, group):
            assert any(f" {element.name}: " in line for line in text.splitlines()), element.name


def test_contacts_have_a_line_and_their_spheres_are_drawn():
    (case,) = load_cases("bouncing_sphere")
    (contact,) = case.mechanism.contacts
    assert (
        f"contact {contact.name}: {contact.body} on {contact.partner}, sphere on plane, restitution "
        in describe_case(case)
    )
    lines = figure_of(case.mechanism, case.initial_state).lines
    circles = [line.points for line in lines if line.kind == "circle"]
    assert len(circles) == 3
    for points in circles:
        away = np.linalg.norm(points - case.initial_state.p_WB[0], axis=1)
        assert away == pytest.approx(np.full(len(points), contact.radius), abs=np.linalg.norm(contact.center) + 1e-12)


def test_planes_and_boxes_of_contacts_are_drawn_once_each():
    (case,) = load_cases("pulled_boxes")
    m, start = case.mechanism, case.initial_state
    lines = figure_of(m, start).lines
    planes = [line for line in lines if line.kind == "plane"]
    assert [line.body for line in planes] == [-1, m.body_index["lower"]]
    for contact, plane in zip(m.contacts, planes, strict=True):
        _, R = body_place(m, start, contact.partner)
        heights = (plane.points - body_point(m, start, contact.partner, contact.point)[0]) @ R @ contact.normal
        assert heights == pytest.approx(np.zeros(5), abs=1e-12)
    edges = [line.points for line in lines if line.kind == "edge"]
    lengths = sorted(np.linalg.norm(e[1] - e[0]) for e in edges)
    assert lengths == pytest.approx(sorted([*[1.0] * 4, *[0.6] * 4, *[0.2] * 16]))


def body_place(mechanism, state, body):
    if body == "ground":
        return np.zeros(3), np.eye(3)
    i = mechanism.body_index[body]
    return state.p_WB[i], state.R_WB[i]


@pytest.mark.parametrize("element", [Rolling("r", "ground", [0, 0, 0], [1, 0, 0], 1.0, [0, 0, 0], [0, 0, 1])])
def test_the_ground_does_not_roll(element):
    with pytest.raises(InvalidInput, match=r"rolling 'r': body: the ground does not move"):
        dataclasses.replace(ELEMENTS["skating"], rollings=(element,))


def test_the_ground_does_not_skate():
    with pytest.raises(InvalidInput, match=r"skate 's': body: the ground does not move"):
        dataclasses.replace(ELEMENTS["skating"], skates=(Skate("s", "ground", [0, 0, 0], [1, 0, 0]),))


def test_the_page_of_a_case_says_what_is_redundant_and_open_and_known():
    (case,) = family_cases("four_bar")
    text = describe_case(case)
    assert "1 degree of freedom, 20 constraint rows, 3 of them dependent" in text
    assert "rows that depend on one another: crank_pivot, crank_pin, rocker_pin, rocker_pivot: Z D13 D23" in text
    assert "equilibrium does not determine: crank_pivot, crank_pin, rocker_pin, rocker_pivot: force z, torque x" in text
    assert "an engine needs: revolute joint" in text
    assert re.search(r"expected: w_WB_W \(x, y, z\) of coupler at 0 s: .* uncertain by .*; closed form: ", text)
    assert draw(case.mechanism, case.initial_state) in text


# ---------------------------------------------------------------- drawings

EVERYTHING = {**TREES, **LOOPS, **ELEMENTS}


@pytest.mark.parametrize("name", EVERYTHING)
def test_every_mechanism_is_drawn_within_its_frame_with_every_joint_and_body_named(name):
    mechanism = EVERYTHING[name]
    (state,) = states_of(mechanism, 1)
    drawing, _, legend = draw(mechanism, state).partition(" of the world; ")
    rows = drawing.splitlines()[:-2]
    assert 1 <= len(rows) <= ROWS
    assert max(map(len, rows)) <= COLUMNS
    for joint, letter in zip(mechanism.joints, "ABCDEFGHIJ", strict=False):
        assert f"  {letter}  {joint.name}: {joint.kind}, {joint.predecessor} - {joint.successor}" in legend
        assert letter in "".join(rows) or f"{joint.predecessor} - {joint.successor}, behind " in legend
    for body in mechanism.bodies:
        assert body.name in legend


def test_a_drawing_keeps_angles_and_puts_up_against_gravity():
    (case,) = family_cases("windows:count=2")
    rows = draw(case.mechanism, case.initial_state).splitlines()
    at = {letter: (r, row.index(letter)) for letter in "ABCDF" for r, row in enumerate(rows[:20]) if letter in row}
    assert at["B"][0] < at["A"][0]
    assert at["B"][1] == at["A"][1]
    # a square has twice as many columns as rows, within one cell
    assert at["D"][1] - at["B"][1] == pytest.approx(2 * (at["A"][0] - at["B"][0]), abs=2)
    assert rows[at["A"][0] + 1][at["A"][1]] == "▔"


def test_a_long_chain_lies_on_its_side():
    (case,) = family_cases("chain:bodies=20")
    (line,) = [row for row in draw(case.mechanism, case.initial_state).splitlines() if "of the world" in row]
    right = [float(x) for x in re.search(r"right \(([^)]*)\)", line).group(1).split(",")]
    assert right[2] < -0.9


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "branched"])
def test_the_view_is_the_widest_and_upright(name):
    mechanism = EVERYTHING[name]
    (state,) = states_of(mechanism, 1)
    figure = figure_of(mechanism, state)
    view = widest_view(figure)
    assert np.abs(view @ view.T - np.eye(2)).max() < 1e-12
    centered = figure.points - figure.points.mean(axis=0)
    kept = np.sum((centered @ view.T) ** 2)
    rng = np.random.default_rng(1)
    for _ in range(50):
        other = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
        assert np.sum((centered @ other.T) ** 2) <= kept * (1 + 1e-12)
    assert view[1] @ upright(mechanism.gravity)[1] >= -1e-12


def test_a_png_is_the_picture_at_twice_its_size_with_its_words():
    case = load_cases("four_bar")[0]
    svg = picture(case.mechanism, case.initial_state, "")
    from matplotlib.image import imread

    image = imread(BytesIO(as_png(svg)), format="png")
    assert image.shape[:2] == tuple(2 * round(float(ET.fromstring(svg).get(side))) for side in ("height", "width"))
    words = image[120:420, 1860:, :3]  # the column of names, which has words alone
    assert 0.005 < np.mean(words < 0.5) < 0.2


def test_every_body_of_every_case_is_drawn():
    for case in shipped_cases():
        if not case.unassembled:
            lines = figure_of(case.mechanism, case.initial_state).lines
            assert {line.body for line in lines} - {-1} == set(range(len(case.mechanism.bodies))), case.name


def test_all_ink_of_a_picture_has_another_colour_on_a_dark_ground():
    svg = picture(chain("revolute"), states_of(chain("revolute"), 1)[0], "")
    root, style = ET.fromstring(svg), ET.fromstring(svg).find("{*}style").text
    told = {name for rule in re.findall(r"[^{}]*(?= \{ )", style) for name in re.findall(r"\.([a-z]+)", rule)}
    bodies = {"none", *COLOURS}
    for element in root.iter():
        colours = {element.get(name) for name in ("fill", "stroke")} - {None, *bodies}
        if colours:
            assert told & set((element.get("class") or "").split()), (element.tag, colours)


@pytest.mark.parametrize("name", EVERYTHING)
def test_a_picture_is_svg_in_four_views_with_every_name(name):
    mechanism = EVERYTHING[name]
    (state,) = states_of(mechanism, 1)
    root = ET.fromstring(picture(mechanism, state, "a < b & c"))
    assert root.find("{*}title").text == "a < b & c"
    words = "".join(root.itertext())
    for title in ("from above", "from the front", "from the right", "axonometric"):
        assert title in words
    for named in (*mechanism.joints, *mechanism.bodies):
        assert named.name in words
    numbers = [float(x) for line in root.iter("{*}polyline") for x in re.split(r"[ ,]", line.get("points"))]
    assert np.all(np.isfinite(numbers))
    assert min(numbers, default=0) >= 0
    assert max(numbers, default=0) <= 460


def test_views_are_those_of_third_angle_projection():
    """A point to the right, up and in front: low in the view from above, on the left in the view from the right."""
    (case,) = family_cases("single_joint:kind=prismatic")
    figure = figure_of(case.mechanism, case.initial_state)
    right, up, toward = upright(figure.gravity)
    assert np.array_equal(np.cross(right, up), toward)
    above, front, side, tilted = (view.axes for view in views(figure))
    point = right + 2 * up + 3 * toward
    assert np.allclose(above @ point, [1, -3])
    assert np.allclose(front @ point, [1, 2])
    assert np.allclose(side @ point, [-3, 2])
    assert tilted[1] @ up > 0.8
    for axes in (above, front, side, tilted):
        assert np.abs(axes @ axes.T - np.eye(2)).max() < 1e-12


def _distance(point, start, end):
    along = end - start
    part = np.clip((point - start) @ along / max(along @ along, 1e-300), 0.0, 1.0)
    return np.linalg.norm(start + part * along - point)


@pytest.mark.parametrize("name", ["stewart_platform", "excavator_arm", "gear_pair", "double_wishbone"])
def test_every_body_is_drawn_to_its_joints_and_its_centre_of_mass(name):
    """A plate is its outline, a boom reaches beyond its last joint, and a wheel about its centre is a circle."""
    case = load_cases(name)[0]
    mechanism, state = case.mechanism, case.initial_state
    figure = figure_of(mechanism, state)
    for i, center in enumerate(centres_of_mass(mechanism, state)[0]):
        lines = [line.points for line in figure.lines if line.body == i]
        size = max(np.max(np.ptp(points, axis=0)) for points in lines)
        middles = [np.linalg.norm(points[:-1].mean(axis=0) - center) for points in lines if len(points) > 40]
        apart = [_distance(center, a, b) for points in lines for a, b in pairwise(points)]
        assert min([*apart, *middles]) <= 0.05 * size
    if name == "stewart_platform":
        (plate,) = [line.points for line in figure.lines if line.body == 0 and len(line.points) > 2]
        joints = [mark.point for mark in figure.joints if mark.kind == "spherical"]
        assert np.allclose(plate[0], plate[-1])
        assert sorted(map(tuple, plate[:-1].round(6))) == sorted(map(tuple, np.round(joints, 6)))


def test_contacts_say_what_they_do_at_the_start():
    """Two boxes at rest; a ball 0.5 m above its floor; a block that slides at 3 m/s; shaken by hand: 1 m/s downward."""
    assert "contact between at the start: closed, no slip" in described("pulled_boxes")
    assert "contact floor at the start: apart by 0.5 m" in described("bounces_that_grip")
    assert "contact floor at the start: closed, slides at 3 m/s" in described("skew_slide_circle")
    hits = load_case("skew_slide_circle")
    (floor,) = hits.mechanism.contacts
    v, w = hits.initial_state.v_WB_W[0], hits.initial_state.w_WB_W[0]
    falling = dataclasses.replace(hits, initial=Initial(velocities={"block": (v - floor.normal, w)}))
    assert "closed, approaches at 1 m/s and slides at 3 m/s" in describe_case(falling)


def test_a_plane_is_drawn_as_far_as_the_shape_above_it():
    """The rim of a tilted disc reaches farther than the point that touches: every foot is within the square."""
    case = load_case("eulers_disc")
    m, start = case.mechanism, case.initial_state
    (rim,) = m.contacts
    drawn = figure_of(m, start).lines
    (plane,), (circle,) = ([line.points for line in drawn if line.kind == kind] for kind in ("plane", "circle"))
    feet = circle - np.outer((circle - plane[0]) @ rim.normal, rim.normal)
    sides = np.diff(plane, axis=0)
    for corner, side in zip(plane[:-1], sides, strict=True):
        inward = np.cross(rim.normal, side)
        inward *= np.sign(inward @ (plane[:-1].mean(axis=0) - corner))
        assert np.min((feet - corner) @ inward) > 0.0


def described(name):
    return describe_case(load_case(name))
