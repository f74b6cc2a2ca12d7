"""Plateaus of a sliding cube at the engines' defaults, explained by their laws of friction (`plateaus`)."""

import pytest

from consilience.engine import Profile, load_engine
from plateaus import plateaus


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "package", "heading"), [("mujoco", "mujoco", 20.0), ("mujoco", "mujoco", 30.0), ("dart", "dartpy", 30.0)]
)
def test_the_place_where_a_cube_stops_is_that_of_the_law_that_the_method_states(name, package, heading):
    pytest.importorskip(package)
    found = list(plateaus(load_engine(name), heading, lambda method: method.profile is Profile.DEFAULT))
    assert found
    for one in found:
        assert one.plateau > 5e-4
        assert one.off < 1e-3 * one.plateau
