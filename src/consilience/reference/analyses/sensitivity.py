"""Sensitivity of any result to any parameter of a mechanism or case, with an error estimate.

Central differences at steps h, h/2, h/4, ..., extrapolated to h = 0 in a Neville tableau (Richardson, 1911; Ridders,
1982):

    A(i, 0) = (f(p + h_i) - f(p - h_i)) / (2 h_i),    A(i, j) = A(i, j-1) + (A(i, j-1) - A(i-1, j-1)) / (4^j - 1).

The error of an entry is estimated by its difference from the two entries before it; for each component of the result
the entry of least error is chosen. A result is a function of the mechanism or case: it includes everything that depends
on the parameter (the assembled pose, an equilibrium).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from consilience.case import Case
from consilience.errors import ConsilienceError, InvalidInput
from consilience.mechanism import Array, Mechanism, characteristic_length, float_array
from consilience.reference.analyses.parameters import T, array_around, parameter, with_parameter

_FIRST_STEP = 0.05
"""First step, in units of `parameter_scale`."""
_LEVELS = 9
_PATIENCE = 2
"""Levels without a smaller error estimate before extrapolation ends: rounding dominates."""
_SHORTENINGS = 12
_POINTS = (".p", ".com", ".point", ".point_predecessor", ".point_successor", ".center")


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Derivatives of a result.

    Attributes
    ----------
    paths : tuple of str
    value : ndarray, any shape
        The result at the given parameters.
    derivatives : ndarray, shape (n_paths, *value.shape)
        Unit of the result over that of the parameter.
    errors : ndarray, shape (n_paths, *value.shape)
        Estimated errors of the derivatives, truncation and rounding.
    """

    paths: tuple[str, ...]
    value: Array
    derivatives: Array
    errors: Array


def parameter_scale(subject: Mechanism | Case, path: str) -> float:
    """Return the scale of a parameter: the largest entry of its array.

    If that is zero: the length of the mechanism for a point, else 1 (rad or SI unit).
    """
    largest = float(np.max(np.abs(array_around(subject, path))))
    if largest > 0.0 and ".turn[" not in path and not path.endswith(("angle", "angle1", "angle2")):
        return largest
    mechanism = subject if isinstance(subject, Mechanism) else subject.mechanism
    is_point = path.partition("[")[0].endswith(_POINTS)
    return characteristic_length(mechanism) if is_point else 1.0


def sensitivity(
    subject: T, result: Callable[[T], ArrayLike], paths: Sequence[str], steps: Mapping[str, float] | None = None
) -> Sensitivity:
    """Differentiate a result with respect to parameters.

    Parameters
    ----------
    subject : Mechanism or Case
    result : function of the subject, to a number or an array
        Any finite result, smooth in the parameters, including the assembly.
    paths : sequence of str
        See `consilience.reference.analyses.parameters`.
    steps : mapping of path to float, optional
        First steps of the differences, in units of the parameters; default 0.05 of `parameter_scale`.

    Returns
    -------
    Sensitivity

    Raises
    ------
    InvalidInput
        Unknown path; a parameter without a result at any small change, with the reason (in a loop with redundant
        constraints single pins cannot be moved).
    """

    def of(given: T) -> Array:
        return float_array(result(given), "result", "Return a number or an array of numbers.")

    value = of(subject)
    derivatives, errors = [np.zeros((0, *value.shape))], [np.zeros((0, *value.shape))]
    for path in paths:
        at = parameter(subject, path)
        first = (steps or {}).get(path, _FIRST_STEP * parameter_scale(subject, path))

        def of_step(h: float, path: str = path, at: float = at) -> Array:
            return of(with_parameter(subject, path, at + h))

        derivative, error = ridders(of_step, first, f"parameter '{path}'")
        derivatives.append(derivative[None])
        errors.append(error[None])
    return Sensitivity(tuple(paths), value, np.concatenate(derivatives), np.concatenate(errors))


def ridders(function: Callable[[float], Array], step: float, where: str) -> tuple[Array, Array]:
    """Differentiate a function of one number at zero; return derivative and estimated error by components.

    Parameters
    ----------
    function : function of a float to an ndarray
    step : float
        First step, halved until the function can be evaluated.
    where : str
        Name in messages.

    Raises
    ------
    InvalidInput
        If the function cannot be evaluated at any step.
    """
    step, pair = _usable(function, step, where)
    rows: list[list[Array]] = []
    best = error = np.zeros(0)
    without_gain = 0
    for level in range(_LEVELS):
        h = step / 2**level
        ahead, behind = pair if level == 0 else (function(h), function(-h))
        row = [(ahead - behind) / (2.0 * h)]
        rounding = np.finfo(float).eps * (np.abs(ahead) + np.abs(behind)) / h
        if level == 0:
            best, error = row[0], np.full(np.shape(ahead), np.inf)
        gained = False
        for j, before in enumerate(rows[-1] if rows else []):
            row.append(row[j] + (row[j] - before) / (4.0 ** (j + 1) - 1.0))
            uncertainty = np.maximum(np.abs(row[j + 1] - row[j]), np.abs(row[j + 1] - before)) + rounding
            better = uncertainty < error
            best, error = np.where(better, row[j + 1], best), np.where(better, uncertainty, error)
            gained = gained or bool(np.any(better))
        rows.append(row)
        without_gain = 0 if gained or level == 0 else without_gain + 1
        if without_gain == _PATIENCE:
            break
    return best, error


def _usable(function: Callable[[float], Array], step: float, where: str) -> tuple[float, tuple[Array, Array]]:
    """Halve the step until the function can be evaluated on both sides; return step and values."""
    reason: Any = None
    for _ in range(_SHORTENINGS):
        try:
            return step, (function(step), function(-step))
        except ConsilienceError as error:
            reason, step = error, 0.5 * step
    raise InvalidInput(where, f"no small change of it leaves a result: {reason}", "Leave it out, or change the result.")
