"""Random mechanisms with contacts whose modes an adapter finds by trying: accelerations are those of the reference."""

import numpy as np
import pytest

from consilience.audit.fuzz.population import specimen
from consilience.case import load_cases
from consilience.engine import CannotRepresent, Question, load_engine
from consilience.mechanism import determinate_forces


def accelerations(engine, case):
    """Return the accelerations of all bodies at the first state, one column, by the headline method."""
    engine = load_engine(engine)
    answer = engine.instant(case.mechanism, case.states[:1], engine.methods(case.mechanism, Question.INSTANT)[0])
    return np.concatenate([answer.a_WB_W.ravel(), answer.alpha_WB_W.ravel()])


@pytest.mark.parametrize(
    ("engine", "seed", "digits"),
    [
        pytest.param("mujoco", 35050, 12, id="loops beside a contact that slides"),
        pytest.param("mujoco", 35063, 12, id="a box that leaves a plane, held by loops"),
        pytest.param("mujoco", 35071, 9, id="a contact that opens, and closes again as others slide"),
        pytest.param("mujoco", 35085, 12, id="loops that hold everything, with five contacts"),
        pytest.param("pinocchio", 35072, 10, id="a contact whose rows depend on those of a loop"),
        pytest.param("dart", 8936, 8, id="loops that the first solver of friction leaves open"),
        pytest.param("pinocchio", 135, 9, id="a stop that a loop holds"),
    ],
)
def test_modes_of_several_contacts_settle(engine, seed, digits):
    case = specimen(seed, contacts=True).case
    found, wanted = accelerations(engine, case), accelerations("reference", case)
    assert np.max(np.abs(found - wanted)) <= 10.0**-digits * max(1.0, np.max(np.abs(wanted)))


@pytest.mark.parametrize("seed", [8966, 9063])
def test_a_contact_carries_what_is_beyond_the_dry_friction_beside_it(seed):
    case = specimen(seed, contacts=True).case
    mechanism, state = case.mechanism, case.states[0]
    known, found = determinate_forces(mechanism, state).reactions, []
    for engine in map(load_engine, ("exudyn", "reference")):
        answer = engine.instant(mechanism, [state], engine.methods(mechanism, Question.INSTANT)[0])
        assert answer.force_F is not None
        assert answer.torque_F is not None
        found.append(np.hstack([answer.force_F[0], answer.torque_F[0]])[known])
    np.testing.assert_allclose(*found, atol=1e-10 * np.max(np.abs(found[1])))


@pytest.mark.parametrize("seed", [35071, 9094])
def test_contacts_that_fit_in_no_way_at_rest_start_to_slide(seed):
    case = specimen(seed, contacts=True).case
    with pytest.raises(CannotRepresent, match="starts to slide"):
        accelerations("exudyn", case)


@pytest.mark.parametrize("engine", ["dart", "exudyn", "mujoco", "pinocchio"])
@pytest.mark.parametrize("name", ["bounces_to_rest", "hinge_between_stops", "rod_hits_floor"])
def test_what_bounces_has_no_order_above_one(engine, name):
    engine, mechanism = load_engine(engine), load_cases(name)[0].mechanism
    if not engine.unsupported(mechanism, Question.TRAJECTORY):
        assert {method.order for method in engine.methods(mechanism, Question.TRAJECTORY)} == {1}
