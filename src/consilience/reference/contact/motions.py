"""Motions with contacts, friction and stops, computed in a mechanism's own units.

Lengths, masses and times of a mechanism are near one in its own units (`motion_units`): constants of the simulation
that are neither relative to a length nor to a speed act alike at any size. The factors are powers of two, so that
nothing is rounded.
"""

from __future__ import annotations

from dataclasses import replace

from consilience.engine import TrajectoryAnswer
from consilience.mechanism import (
    Array,
    Contact,
    Mechanism,
    State,
    Units,
    kept_in_units,
    motion_units,
    refuse_flat_discs,
    require_states,
    telling_si,
)
from consilience.reference.bodies.arrays import pack
from consilience.reference.bodies.canonical import sample_times
from consilience.reference.bodies.consistency import check_given
from consilience.reference.contact.energy_balance import refuse_lost_energy
from consilience.reference.contact.impact import Impact
from consilience.reference.contact.layout import layout_of
from consilience.reference.contact.samples import ContactEvent
from consilience.reference.contact.simulation import ContactSimulation


def simulate_with_contacts(
    mechanism: Mechanism, state: State, times: Array, tolerance: float = 1e-12, impacts: str = "newton"
) -> tuple[TrajectoryAnswer, tuple[ContactEvent, ...]]:
    """Integrate the motion of a mechanism with its contacts, stops and dry frictions.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
        Consistent state at ``times[0]``, no contact overlapping; contacts may be closed.
    times : ndarray, shape (n_t,), s
        Increasing sample times; at the instant of an impact the sample has the velocities after it.
    tolerance : float
        Bound on the scaled local error of a step, 1e-13 to 1e-3.
    impacts : str
        Law of impacts of contacts that ask for no other: ``newton``, or ``moreau``, that of time stepping.

    Returns
    -------
    TrajectoryAnswer
        With contact gaps, impulses, modes, losses and events, and the counters ``steps``, ``evaluations``, ``impacts``.
    tuple of ContactEvent
        In order of time.

    Raises
    ------
    InvalidInput
        Tolerance out of range, times that do not increase, a state that is not consistent, a contact that overlaps at
        the start, or a disc that is parallel to its plane there.
    NumericalFailure
        The laws of contact have no solution or several (Painleve), a disc comes parallel to its plane, energy vanishes
        besides the losses, or the integration fails.
    """
    run, answer, back = _integrate(mechanism, state, sample_times(times), tolerance, impacts)
    return answer, tuple(back.convert(event) for event in run.samples.in_order())


def simulate_with_impacts(
    mechanism: Mechanism, state: State, times: Array, contacts: tuple[Contact, ...], tolerance: float = 1e-12
) -> tuple[TrajectoryAnswer, tuple[Impact, ...]]:
    """Integrate with these contacts in place of the mechanism's; return the impacts.

    Parameters
    ----------
    mechanism, state, times, tolerance
        As in `simulate_with_contacts`.
    contacts : tuple of contacts
    """
    run, answer, back = _integrate(replace(mechanism, contacts=contacts), state, sample_times(times), tolerance)
    return answer, tuple(impact.record(run.layout).in_units(back) for impact in run.impacts)


def _integrate(
    mechanism: Mechanism, state: State, times: Array, tolerance: float, impacts: str = "newton"
) -> tuple[ContactSimulation, TrajectoryAnswer, Units]:
    """Integrate in the mechanism's own units; return the simulation, the motion in SI units, and what leads back."""
    require_states(mechanism, (state,))
    layout = layout_of(mechanism)
    check_given(layout.smooth, layout.model, times, pack(layout.smooth, state))
    refuse_flat_discs(mechanism, state)
    units = motion_units(mechanism, times)
    own, start, grid = kept_in_units(mechanism, units), units.convert(state), units.time * times
    with telling_si(units):
        run = ContactSimulation(own, start, grid, tolerance, impacts)
        answer = run.integrate(units.length)
        refuse_lost_energy(run.equations, answer, run.samples, run.speed, tolerance)
    return run, replace(units.inverse.convert(answer), time=times), units.inverse
