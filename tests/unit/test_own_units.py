"""Units in which engines compute: with matched settings those of a mechanism that is far from SI units."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.engine import Manifest, Method, Profile, Question, Route
from consilience.engine.worker.own_units import ORDINARY, SETTING, USUAL, _units, units_of, with_units
from consilience.engine.worker.requests import Request, perform
from consilience.mechanism import (
    Compliance,
    ContactLaw,
    Initial,
    JointSpring,
    Regularisation,
    Units,
    characteristic_length,
    in_units,
    initial_state,
)
from consilience.reference import accelerations, simulate
from contact_problems import Lab, pendulum
from mechanisms import TREES, chain, states_of

METHODS = (
    Method("its own", Route.NATIVE, 1, (4,), settings={"knob": 1}),
    Method("defaults", Route.NATIVE, 1, (4,), profile=Profile.DEFAULT),
)


def test_arms_of_rounding_are_no_length():
    """What is left is the radius of gyration."""
    free = Lab().free_body(2.0, 2.0 * 0.3**2 * np.ones(3), np.zeros(3), ())
    (body,), (joint,), least = free.bodies, free.joints, np.array([1e-17, 0.0, 0.0])
    joint = replace(joint, M=replace(joint.M, p=least))
    ball = replace(free, bodies=(replace(body, com=least),), joints=(joint,))
    assert characteristic_length(ball) == pytest.approx(0.3, rel=1e-14)


class Recorder:
    """The reference as an engine that keeps what it is given."""

    def __init__(self):
        self.given = []

    def unsupported(self, mechanism, question):
        return ()

    def methods(self, mechanism, question):
        return METHODS

    def manifest(self, mechanism):
        return Manifest()

    def instant(self, mechanism, states, method):
        self.given.append((mechanism, method))
        return accelerations(mechanism, states)

    def trajectory(self, mechanism, state, times, method, step):
        self.given.append((mechanism, method))
        assert step == (times[1] - times[0]) / 4
        return simulate(mechanism, state, times, 1e-10)


@pytest.mark.parametrize("units", [Units(1e6, 1e-5, 1e4), Units(1e-5, 1e6, 1e-4)])
def test_a_method_with_matched_settings_gets_usual_sizes_and_answers_in_si_units(units):
    base, engine = TREES["branched"], Recorder()
    (start,) = states_of(base, 1)
    mechanism, times = in_units(base, *units), np.linspace(0.0, 0.1, 3)
    matched, default = perform(engine, Request(mechanism)).methods[Question.INSTANT]
    motion = {"times": units.time * times, "step": units.time * times[1] / 4}
    for question, more, expected in (
        (Question.INSTANT, {}, accelerations(base, [start])),
        (Question.TRAJECTORY, motion, simulate(base, start, times, 1e-10)),
    ):
        found = perform(engine, Request(mechanism, question, matched, [units.convert(start)], **more))
        own, method = engine.given[-1]
        assert method.settings == METHODS[0].settings, "an adapter does not know the units"
        length, mass, time = USUAL
        sizes = characteristic_length(own) / length, sum(b.mass for b in own.bodies) / mass
        assert all(0.1 < size < 10.0 for size in (*sizes, np.linalg.norm(own.gravity) * time**2 / length)), sizes
        for name, value in vars(units.convert(expected)).items():
            if isinstance(value, np.ndarray):
                least = 1e-9 * np.max(np.abs(value), initial=0.0)
                np.testing.assert_allclose(getattr(found, name), value, rtol=0, atol=least, err_msg=name)
    perform(engine, Request(mechanism, Question.INSTANT, default, [units.convert(start)]))
    assert engine.given[-1] == (mechanism, METHODS[1])


def test_without_forces_the_start_tells_the_unit_of_time():
    base = replace(TREES["branched"], gravity=np.zeros(3), springs=(), joint_springs=(), loads=(), controls=())
    (start,), slow = states_of(base, 1), Units(time=1e6)
    mechanism = in_units(base, *slow)
    (matched, _), (still, _) = (
        perform(Recorder(), Request(mechanism, states=states)).methods[Question.INSTANT]
        for states in ([slow.convert(start)], [])
    )
    assert matched.settings[SETTING][2] > 1e5
    assert SETTING not in still.settings


def test_ordinary_sizes_and_defaults_have_no_units_of_their_own():
    long = USUAL[0] * ORDINARY / characteristic_length(TREES["branched"])
    far, near = (in_units(TREES["branched"], length=factor * long) for factor in (2.0, 0.5))
    assert perform(Recorder(), Request(near)).methods[Question.TRAJECTORY] == METHODS
    matched, default = perform(Recorder(), Request(far)).methods[Question.TRAJECTORY]
    assert matched.settings["knob"] == 1
    assert SETTING in matched.settings
    assert default == METHODS[1]


@pytest.mark.parametrize(("factor", "told"), [(2.0**-6, False), (2.0**-2, False), (2.0**4, True)])
def test_a_fast_mechanism_has_a_unit_of_time_of_its_own(factor, told):
    """Rates in multiples of the usual one: from `FAST` on, and not where they are slower by less than `ORDINARY`."""
    mechanism = TREES["branched"]
    (start,) = states_of(mechanism, 1)
    units = Units(time=_units(mechanism, [start]).time / factor)
    own = in_units(mechanism, *units)
    (found,) = with_units(own, [units.convert(start)], Question.TRAJECTORY, METHODS[:1])
    assert (SETTING in found.settings) == told


def test_a_law_of_contact_has_the_engines_numbers_in_its_units():
    base, units = pendulum(Lab(), 0.3), Units(1e-4, 1e5, 1e-3)
    mechanism, (start,) = in_units(base, *units), states_of(base, 1)
    law = ContactLaw(compliance=Compliance(7.0, 5.0), rebound_threshold=0.1, impact_law="moreau")
    method = replace(METHODS[0], law=law)
    (found,) = with_units(mechanism, [units.convert(start)], Question.TRAJECTORY, (method,))
    length, mass, time = found.settings[SETTING]
    assert length < 1e-3
    assert mass > 1e3
    assert time < 0.1
    expected = Compliance(7.0 * mass / time**2, 5.0 * mass / time)
    assert found.law == replace(law, compliance=expected, rebound_threshold=0.1 * length / time)


def test_a_law_of_soft_contacts_is_returned_in_si_units():
    base, units = pendulum(Lab(), 0.3), Units(1e-4, 1e5, 1e-3)
    mechanism, (start,) = in_units(base, *units), states_of(base, 1)
    numbers = {"least": 0.9, "most": 0.95, "midpoint": 0.5, "power": 2.0}
    row = Regularisation(pull=7.0, decay=5.0, width=3.0, inverse_mass=2.0, **numbers)
    method = replace(METHODS[0], soft_law=ContactLaw(regularisation=(row, row)))
    (found,) = with_units(mechanism, [units.convert(start)], Question.TRAJECTORY, (method,))
    length, mass, time = found.settings[SETTING]
    expected = replace(row, pull=7.0 / time**2, decay=5.0 / time, width=3.0 * length, inverse_mass=2.0 / mass)
    assert found.soft_law == ContactLaw(regularisation=(expected, expected))


def test_the_force_at_the_start_tells_the_unit_of_time_where_the_drawing_is_in_equilibrium():
    slide = replace(chain("prismatic"), gravity=np.zeros(3))
    body, joint, rate = slide.bodies[0], slide.joints[0], 1e4
    spring = JointSpring("spring", joint.name, "distance", body.mass * rate**2, 0.0, 0.0)
    mechanism = replace(slide, joint_springs=(spring,))
    start = initial_state(mechanism, Initial({joint.name: {"distance": characteristic_length(mechanism)}}))
    (found,) = with_units(mechanism, [start], Question.TRAJECTORY, METHODS[:1])
    assert 0.5 < rate * found.settings[SETTING][2] * USUAL[2] < 2.0


@pytest.mark.parametrize("strain", [0.0, 1e-17, -1e-13])
@pytest.mark.parametrize("kind", ["prismatic", "revolute"])
def test_what_springs_at_rest_pull_by_rounding_tells_no_unit_of_time(kind, strain):
    """Without gravity, velocity or load; a time of 2^27 s, that of 1e-17 of the length, made three engines fail."""
    alone = replace(chain(kind), gravity=np.zeros(3))
    coordinate = "distance" if kind == "prismatic" else "angle"
    spring = JointSpring("spring", alone.joints[0].name, coordinate, 50.0, 0.0, strain)
    own = _units(replace(alone, joint_springs=(spring,)), states_of(alone, 1)[:0])
    assert 0.5 < own.inverse.time <= 1.0


@pytest.mark.parametrize(
    ("base", "method"),
    [(pendulum(Lab(), 0.3), METHODS[0]), (TREES["branched"], replace(METHODS[0], route=Route.EXTRAPOLATED))],
)
def test_answers_beyond_rounding_are_asked_in_the_same_units_at_any_size(base, method):
    """What an adapter gets is the same to the last bit, for factors of two: absolute constants act alike."""
    (start,), twice, given = states_of(base, 1), Units(2.0, 0.5, 4.0), []
    for units in (Units(), twice):
        mechanism, state = in_units(base, *units), units.convert(start)
        (found,) = with_units(mechanism, [state], Question.INSTANT, (method,))
        own = units_of(found)
        given.append((in_units(mechanism, *own), own.convert(state)))
    (first, at), (second, there) = given
    assert [b.mass for b in first.bodies] == [b.mass for b in second.bodies]
    for name, value in vars(at).items():
        np.testing.assert_array_equal(getattr(there, name), value, err_msg=name)
