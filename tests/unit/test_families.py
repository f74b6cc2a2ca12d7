"""Families of cases: names, ranges of parameters, closed-form values and documentation."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from consilience.case import read_motion
from consilience.case.families import FAMILIES, family_cases, family_table, parameters, shown_parameters
from consilience.case.families.closed_forms import HeavyTop, oscillator, pendulum, second_kind_inverse
from consilience.case.file.reader import cases_from_tables
from consilience.case.file.writer import table_text
from consilience.errors import InvalidInput
from consilience.mechanism import free_directions
from consilience.reference import simulate
from consilience.reference.contact import simulate_with_contacts
from oracles.closed_forms.sliding import coulomb_slide, polygon_slide

KNOWN = {
    "windows:count=1": 1e-8,  # passes the pose with all rods collinear, where the reference loses digits
    "windows": 1e-8,
    "parallel_rods": 1e-11,
    "parallel_rods:rods=3,angle=2,seed=4": 1e-10,  # three hinges nearly collinear: ill-conditioned
    "scissor:stages=1": 1e-11,
    "scissor:angle=1,rate=-0.5": 1e-11,
    "four_bar": 1e-11,
    "four_bar:distance=1e-06,angle=-0.7,rate=-3": 1e-11,
    "planar_chain": 1e-11,
    "planar_chain:bodies=8,mode=8,amplitude=0.0001": 1e-11,
    "mass_ratio:ratio=0.001,mode=fast": 1e-11,
    "mass_ratio:ratio=10000,mode=fast,amplitude=1e-05": 1e-11,
    "mass_ratio:ratio=100": 1e-11,
    "spring_chain": 1e-11,
    "spring_chain:masses=8,stiffness=900,damping=3": 1e-11,
    "stiff_spring:stiffness=10000": 1e-11,
    "stiff_spring:stiffness=100000,damping_ratio=0.3,speed=1": 1e-11,
    "top": 1e-11,
    "top:spin=4,tilt=2.5,precession=0,nutation=-0.6": 1e-11,
    **{
        f"single_joint:kind={kind},seed={seed}": 1e-11
        for kind in ("revolute", "prismatic", "cylindrical", "planar", "rigid", "free", "parallel_axes")
        for seed in (1, 2)
    },
    "sliding_cube:cone=box": 1e-11,
    "balls_in_line": 1e-11,
    "balls_in_line:balls=2,restitution=0.3,gap=0.3": 1e-11,
    **{f"balls_in_line:balls={n},restitution={e}": 1e-11 for n in (3, 5) for e in (0.5, 1)},
    "balls_on_box": 1e-11,
    "balls_on_box:rows=1,heading=-100": 1e-11,
}
"""Members with closed-form values, and bounds for the error of the reference."""

FREEDOM = {
    "windows:count=3": (1, 5 * 10 - 6 * 7 + 1),
    "parallel_rods:rods=5": (1, 4 * 5 - 5),
    "scissor:stages=4": (1, 5 * 13 - 6 * 9 + 1),
    "closed_ring:bodies=7": (5, 3),
    "closed_ring:bodies=7,hinges=skew": (2, 0),
    "four_bar": (1, 3),
    "chain:bodies=6": (6, 0),
    "planar_chain:bodies=6": (6, 0),
    "spring_chain:masses=6": (6, 0),
    "top": (3, 0),
    "single_joint:kind=screw": (1, 0),
    "single_joint:kind=point_in_plane": (5, 0),
}
"""Degrees of freedom and number of dependent rows, counted by hand."""


def motion(case):
    if case.mechanism.contacts:
        return simulate_with_contacts(case.mechanism, case.initial_state, case.times, 1e-12)[0]
    return simulate(case.mechanism, case.initial_state, case.times, 1e-12)


@pytest.mark.parametrize("name", KNOWN)
def test_the_reference_meets_every_value_in_closed_form(name):
    (case,) = family_cases(name)
    assert case.name == name
    assert case.published
    answer = motion(case)
    for known in case.published:
        assert known.origin == "closed form"
        off = known.off(read_motion(case.mechanism, known, answer))
        assert off <= known.uncertainty + KNOWN[name], known.name
        assert known.uncertainty < 0.02 * max(abs(known.value), 1e-3)


@pytest.mark.parametrize("name", FREEDOM)
def test_freedom_and_redundancy_are_what_the_family_promises(name):
    (case,) = family_cases(name)
    mechanism = case.mechanism
    freedom = free_directions(mechanism, case.initial_state).shape[1]
    redundant = mechanism.constraint_count() - (6 * len(mechanism.bodies) - freedom)
    assert (freedom, redundant) == FREEDOM[name]


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_is_the_same_case_again_also_through_a_file(family):
    name, table = family_table(family)
    assert name == family
    assert table == family_table(family)[1]
    (case,) = family_cases(family)
    (again,) = cases_from_tables(family, family, tomllib.loads(table_text(table)))
    for field in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W"):
        assert np.array_equal(getattr(case.initial_state, field), getattr(again.initial_state, field))
    assert case.published == again.published
    assert case.sources
    assert case.remarks


@pytest.mark.parametrize("family", FAMILIES)
def test_documentation_says_type_range_and_source_of_every_parameter(family):
    text = FAMILIES[family].__doc__
    page = (Path(__file__).parents[2] / "docs" / "families.md").read_text(encoding="utf-8")
    row = next(line for line in page.splitlines() if line.startswith(f"| `{family}` |"))
    for heading in ("Parameters", "Returns"):
        assert f"{heading}\n" in text
    for p in parameters(FAMILIES[family]).values():
        assert p.name in text
        assert f"`{p.name}`" in row
        allowed = p.allowed_text().removesuffix(f" {getattr(p.allowed, 'unit', '')}")
        assert allowed in row or family == "single_joint", f"{p.name}: {allowed}"
    assert shown_parameters(FAMILIES[family]) in page


SPOILT = {
    "wheels": ("no family 'wheels'", "windows"),
    "windows:number=3": ("number", "count"),
    "windows:count": ("no value", "windows:count=2"),
    "windows:count=": ("no value", "count=2"),
    "windows:count=2.5": ("not an integer", "1 to 200"),
    "windows:count=0": ("out of range", "1 to 200"),
    "windows:count=2,count=3": ("given twice", "once"),
    "stiff_spring:stiffness=stiff": ("not a number", "N/m"),
    "stiff_spring:stiffness=nan": ("out of range", "N/m"),
    "stiff_spring:stiffness=1e20": ("out of range", "10 to 1e+14 N/m"),
    "mass_ratio:mode=medium": ("not one of its values", "slow or fast"),
    "single_joint:kind=hinge": ("not one of its values", "revolute"),
    "planar_chain:bodies=3,mode=4": ("mode 4 of a chain of 3|4 of a chain of 3", "1 to 3"),
    "closed_ring:bodies=5,hinges=skew": ("cannot move", "at least 6"),
    "four_bar:crank=1.0,distance=0.9": ("closes there", "other lengths"),
    "spring_chain:stiffness=1,damping=100": ("more than critical", "less than"),
}


@pytest.mark.parametrize("name", SPOILT)
def test_a_wrong_name_is_one_clear_message(name):
    what, remedy = SPOILT[name]
    with pytest.raises(InvalidInput, match=what) as raised:
        family_cases(name)
    assert f"case '{name}'" in str(raised.value)
    assert remedy in str(raised.value)


def test_parameters_come_in_any_order_with_spaces_and_are_named_in_their_own():
    (case,) = family_cases("chain: seed=2 , bodies=3")
    assert case.name == "chain:bodies=3,seed=2"
    assert len(case.mechanism.bodies) == 3
    (other,) = family_cases("chain:bodies=3,seed=3")
    assert not np.allclose(case.mechanism.bodies[0].com, other.mechanism.bodies[0].com)


def test_nothing_is_claimed_where_an_oscillation_is_not_small():
    assert family_cases("planar_chain")[0].published
    assert not family_cases("planar_chain:amplitude=0.5")[0].published
    assert not family_cases("mass_ratio:ratio=1e6,mode=fast,amplitude=0.01")[0].published


# ---------------------------------------------------------------- closed forms without a mechanism


def integrated(rhs, start, times):
    solution = solve_ivp(rhs, (0.0, times[-1]), start, "DOP853", t_eval=times, rtol=1e-13, atol=1e-13)
    return solution.y


@pytest.mark.parametrize("start", [(0.3, 0.0), (2.9, 0.4), (-np.pi, 1.0), (0.1, -9.0), (7.0, 0.5)])
def test_pendulum_obeys_its_equation(start):
    times = np.linspace(0.0, 4.0, 9)
    angle, rate = pendulum(2.5, *start, times)
    y = integrated(lambda _, y: [y[1], -(2.5**2) * np.sin(y[0])], start, times)
    assert np.abs(angle - y[0]).max() < 1e-10
    assert np.abs(rate - y[1]).max() < 1e-10


def test_oscillator_obeys_its_equation():
    times = np.linspace(0.0, 3.0, 7)
    A = np.array([[0.0, 1.0], [-49.0, -2 * 0.2 * 7.0]])
    exact = [(expm(A * t) @ [0.3, -0.8])[0] for t in times]
    assert np.abs(oscillator(7.0, 0.2, 0.3, -0.8, times) - exact).max() < 1e-14


@pytest.mark.parametrize("rates", [(0.5, 0.2, 20.0), (-1.0, -0.7, 3.0), (0.0, 0.4, 60.0)])
def test_heavy_top_obeys_lagranges_equations(rates):
    I1, I3, mgl, theta = 0.25, 0.04, 6.0, 0.9
    times = np.linspace(0.0, 2.0, 9)
    spin = I3 * (rates[2] + rates[0] * np.cos(theta))
    vertical = I1 * rates[0] * np.sin(theta) ** 2 + spin * np.cos(theta)

    def rhs(_, y):
        c, s = np.cos(y[1]), np.sin(y[1])
        phi = (vertical - spin * c) / (I1 * s * s)
        return [phi, y[3], spin / I3 - phi * c, phi * phi * s * c - spin * phi * s / I1 + mgl * s / I1]

    y = integrated(rhs, [0.3, theta, 0.0, rates[1]], times)
    found = HeavyTop(I1, I3, mgl, (0.3, theta, 0.0), rates).solve(times)
    assert np.abs(found - y[:3].T).max() < 1e-9


@pytest.mark.parametrize("m", [-3.0, 0.0, 0.7, 0.99])
def test_elliptic_integral_is_inverted(m):
    times = np.linspace(0.0, 2.0, 5)
    y = integrated(lambda _, y: [0.8 / np.sqrt(1 - m * np.sin(y[0]) ** 2)], [0.2], times)
    assert np.abs([second_kind_inverse(m, 0.2, 0.8 * t) for t in times] - y[0]).max() < 1e-11


@pytest.mark.parametrize(
    "name", ["planar_chain:bodies=6,mode=2", "planar_chain:bodies=3,mode=3", "mass_ratio:ratio=50,mode=fast"]
)
def test_links_of_chains_move_like_beads(name):
    """Frequency and shape from the matrices of a string of beads, an independent route to the family's polynomials."""
    table = family_table(name)[1]
    beads = np.array([1.0, 50.0]) if "ratio" in name else np.ones(len(table["body"]))
    length = 1.0 if "ratio" in name else 0.5
    slope = 9.81 * np.sqrt(5.0) / 3.0
    tension = slope * np.cumsum(beads[::-1])[::-1]
    K = np.diag(tension + np.append(tension[1:], 0.0)) - np.diag(tension[1:], 1) - np.diag(tension[1:], -1)
    squares, shapes = np.linalg.eig(np.diag(1 / beads) @ K / length)
    angles = np.cumsum([table["initial"]["joints"][f"hinge_{i + 1}"]["angle"] for i in range(len(beads))])
    displacements = np.cumsum(angles)
    order = np.argsort(squares)
    k = order[-1] if "ratio" in name else order[int(name[-1]) - 1]
    shape = shapes[:, k] / shapes[-1, k] * displacements[-1]
    assert np.abs(shape - displacements).max() < 1e-12 * np.abs(displacements).max()
    assert f"w = {np.sqrt(squares[k]):.6g} rad/s" in table["remarks"]


@pytest.mark.parametrize("cone", ["circle", "pyramid", "box"])
@pytest.mark.parametrize(("slope", "heading"), [(0, 20), (0, -110), (15, -130), (15, 180)])
def test_a_cube_stops_where_a_slide_by_the_law_of_its_cone_ends(cone, slope, heading):
    (case,) = family_cases(f"sliding_cube:slope={slope},heading={heading},cone={cone}")
    if slope and cone != "circle":
        assert not case.published
        return
    body, start, a, th = case.mechanism.bodies[0], case.initial_state, np.radians(slope), np.radians(heading)
    B, v = 0.4 * 9.81 * np.cos(a), 2.0 * np.array([np.cos(th), np.sin(th)])
    vertices = {"pyramid": [[1, 0], [0, 1], [-1, 0], [0, -1]], "box": [[1, 1], [-1, 1], [-1, -1], [1, -1]]}
    if cone == "circle":
        way = coulomb_slide([9.81 * np.sin(a), 0.0], B, v, 9.0)[1]
    else:
        way = polygon_slide(vertices[cone], B, v, 9.0)[1]
    n = case.mechanism.contacts[0].normal
    t1 = np.array([1.0, 0.0, 0.0]) - n[0] * n
    t1 /= np.linalg.norm(t1)
    place = start.p_WB[0] + start.R_WB[0] @ body.com + way[0] * t1 + way[1] * np.cross(n, t1)
    assert [known.value for known in case.published] == pytest.approx(place, abs=1e-12)


@pytest.mark.parametrize("heading", [20, 90, 160])
def test_a_cube_on_a_slope_near_level_stops_where_one_on_the_level_does(heading):
    """A slope of 1e-8 deg moves the place by 1e-10 m or so; its powers of the heading overflow by themselves."""
    level, sloping = (family_cases(f"sliding_cube:slope={slope},heading={heading}")[0] for slope in (0, 1e-8))
    assert len(sloping.published) == 3
    assert [p.value for p in sloping.published] == pytest.approx([p.value for p in level.published], abs=1e-9)
    assert sloping.times[-1] == level.times[-1]


@pytest.mark.parametrize(
    "name",
    [
        "box_stack:boxes=1,slope=20,friction=0.3639702342662024",  # above tan(20 deg) by one rounding
        "balls_in_line:gap=0.30000000000000004",
        "balls_in_line:gap=1e-05",
        "sliding_cube:friction=0.1",
    ],
)
def test_the_name_of_a_member_is_the_member(name):
    (case,) = family_cases(name)
    (again,) = family_cases(case.name)
    assert (again.name, again.digest) == (case.name, case.digest)
