"""Effects of parameters on accelerations at a state, to find the parameter of a kind whose error is easiest to see.

An error of a parameter adds wrenches w to the bodies: of a mass those of ``m (g - a)``, of the place of a joint the
moment of its reaction. In the free directions N of the constraints, with the mass matrix M, the accelerations change by
``N (N^T M N)^-1 N^T w`` [Roberson, Schwertassek, Dynamics of Multibody Systems, 1988, section 10.2]. An axis that is
tilted turns the relative acceleration of the bodies of its joint. A coefficient that moves the pose always acts. The
effects are for comparison alone: they leave out how the pose of the constraints itself changes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from consilience.mechanism.applied_forces import Wrenches, applied_wrenches
from consilience.mechanism.constraints import free_directions
from consilience.mechanism.joint_rows import joint_frames
from consilience.mechanism.model import GROUND, Joint, Mechanism, State
from consilience.mechanism.observables import mass_matrix
from consilience.mechanism.perturbation import AXIS, COEFFICIENT, GRAVITY, INERTIA, MASS, OBLIQUE, PLACE
from consilience.mechanism.perturbation import PhysicalParameter as Parameter
from consilience.mechanism.spatial import Array, cross
from consilience.mechanism.units import characteristic_length

_SMALL = 1e-6
"""Relative error of a coefficient or moment; wrenches are linear in nearly all of them."""


class ParameterEffects:
    """Effects of parameters on the accelerations at states of one pose.

    Parameters
    ----------
    mechanism : Mechanism
    states : sequence of State
        Consistent states of one pose.
    a_WB_W, alpha_WB_W : ndarray, shape (n_s, n_b, 3), m/s^2 and rad/s^2
    force_F : ndarray, shape (n_s, n_j, 3), N, or None
        Reactions of the joints, as in an answer to `instant`; without them places of joints have no effect.
    """

    def __init__(
        self, mechanism: Mechanism, states: Sequence[State], a_WB_W: Array, alpha_WB_W: Array, force_F: Array | None
    ) -> None:
        self.mechanism, self.states, self.a, self.alpha, self.force = mechanism, states, a_WB_W, alpha_WB_W, force_F
        self.length = characteristic_length(mechanism)
        self.N = free_directions(mechanism, states[0])
        self.Mr = self.N.T @ mass_matrix(mechanism, states[0]) @ self.N

    def of(self, parameter: Parameter) -> float:
        """Return the largest change of an acceleration, m/s^2, over the size of the error."""
        if parameter.kind == COEFFICIENT and parameter.moves:
            return np.inf
        of_kind = _EFFECTS[parameter.kind]
        return max(of_kind(self, parameter, n) for n in range(len(self.states)))

    def _of_wrenches(self, wrenches: Array) -> float:
        """Return the largest change of an acceleration, m/s^2, that wrenches (n_b, 6) lead to."""
        change = self.N @ np.linalg.lstsq(self.Mr, self.N.T @ wrenches.ravel(), rcond=None)[0]
        largest = np.max(np.abs(change.reshape(-1, 6)), axis=0, initial=0.0)
        found = max(float(np.max(largest[:3])), self.length * float(np.max(largest[3:])))
        return found if np.isfinite(found) else 0.0  # at the singular length of a spring

    def _gravity(self, _: Parameter, n: int) -> float:
        weights = Wrenches(self.mechanism, self.states[n])
        for i, body in enumerate(self.mechanism.bodies):
            state = self.states[n]
            weights.push(body.name, body.mass * self.mechanism.gravity, state.p_WB[i] + state.R_WB[i] @ body.com)
        return self._of_wrenches(weights.total)

    def _mass(self, parameter: Parameter, n: int) -> float:
        i, state, found = parameter.part, self.states[n], Wrenches(self.mechanism, self.states[n])
        body, arm, w = self.mechanism.bodies[i], state.R_WB[i] @ self.mechanism.bodies[i].com, state.w_WB_W[i]
        a = self.a[n, i] + cross(self.alpha[n, i], arm) + cross(w, cross(w, arm))
        found.push(body.name, body.mass * (self.mechanism.gravity - a), state.p_WB[i] + arm)
        return self._of_wrenches(found.total)

    def _inertia(self, parameter: Parameter, n: int) -> float:
        i, state = parameter.part, self.states[n]
        R, w = state.R_WB[i], state.w_WB_W[i]
        changed = parameter.change(self.mechanism, _SMALL).bodies[i].inertia - self.mechanism.bodies[i].inertia
        change = R @ changed @ R.T / _SMALL
        wrenches = np.zeros((len(self.mechanism.bodies), 6))
        wrenches[i, 3:] = -change @ self.alpha[n, i] - cross(w, change @ w)
        return self._of_wrenches(wrenches)

    def _place(self, parameter: Parameter, n: int) -> float:
        joint, found = self.mechanism.joints[parameter.part], Wrenches(self.mechanism, self.states[n])
        if self.force is None:
            return 0.0
        force = joint_frames(self.mechanism, self.states[n], joint).U @ self.force[n, parameter.part]
        moment = self.length * cross(OBLIQUE, force)
        for end, sign in ((joint.successor, 1.0), (joint.predecessor, -1.0)):
            found.push(end, np.zeros(3), np.zeros(3), sign * moment)
        return self._of_wrenches(found.total)

    def _axis(self, parameter: Parameter, n: int) -> float:
        joint = self.mechanism.joints[parameter.part]
        (a_i, alpha_i), (a_j, alpha_j) = (self._at_joint(joint, end, n) for end in (joint.predecessor, joint.successor))
        return float(np.linalg.norm(a_j - a_i) + self.length * np.linalg.norm(alpha_j - alpha_i))

    def _at_joint(self, joint: Joint, end: str, n: int) -> tuple[Array, Array]:
        """Return the acceleration of a body at the origin of F of its joint, m/s^2, and its angular acceleration."""
        if end == GROUND:
            return np.zeros(3), np.zeros(3)
        i, state = self.mechanism.body_index[end], self.states[n]
        frames = joint_frames(self.mechanism, state, joint)
        arm = frames.s_i if end == joint.predecessor else frames.s_j - frames.d
        w, alpha = state.w_WB_W[i], self.alpha[n, i]
        return self.a[n, i] + cross(alpha, arm) + cross(w, cross(w, arm)), alpha

    def _coefficient(self, parameter: Parameter, n: int) -> float:
        changed = applied_wrenches(parameter.change(self.mechanism, _SMALL), self.states[n]).total
        return self._of_wrenches((changed - applied_wrenches(self.mechanism, self.states[n]).total) / _SMALL)


_EFFECTS: dict[str, Callable[[ParameterEffects, Parameter, int], float]] = {
    GRAVITY: ParameterEffects._gravity,
    MASS: ParameterEffects._mass,
    INERTIA: ParameterEffects._inertia,
    PLACE: ParameterEffects._place,
    AXIS: ParameterEffects._axis,
    COEFFICIENT: ParameterEffects._coefficient,
}
"""Effect of a parameter of each kind at the n-th state."""
