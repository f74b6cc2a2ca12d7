"""Text of exported scripts: numbers with all their digits, and functions of elements."""

from __future__ import annotations

from collections.abc import Mapping
from pprint import pformat
from typing import Any

import numpy as np

from consilience.mechanism import Function

JET = '''
def jet(f, x):
    """Value and two derivatives at x of a polynomial, sines (amplitude, frequency, phase) and a curve of pieces."""
    total = [0.0, 0.0, 0.0]

    def powers(coefficients, x):
        value, rate, bend = 0.0, 0.0, 0.0
        for c in reversed(coefficients):
            bend = bend * x + 2.0 * rate
            rate = rate * x + value
            value = value * x + c
        return value, rate, bend

    def add(terms):
        for k, term in enumerate(terms):
            total[k] += term

    add(powers(f["polynomial"], x))
    for a, w, phi in f["harmonics"]:
        s, c = a * math.sin(w * x + phi), a * w * math.cos(w * x + phi)
        add((s, c, -w * w * s))
    if f["pieces"]:
        first, last = f["pieces"][0][0], f["pieces"][-1][1]
        if f["periodic"]:
            x = first + (x - first) % (last - first)
        if not first <= x <= last:
            return math.nan, math.nan, math.nan
        left, _, *coefficients = next(piece for piece in f["pieces"] if x <= piece[1])
        add(powers(coefficients, x - left))
    return total
'''
"""Source of the evaluation of `function_data`; the script imports math."""


def function_data(function: Function) -> dict[str, Any]:
    """Return the numbers of a function: coefficients, sines, and the pieces of the curve."""
    table = function.table
    return {
        "polynomial": function.polynomial,
        "harmonics": function.harmonics,
        "pieces": [] if table is None else table.pieces,
        "periodic": table is not None and table.periodic,
    }


def _plain(value: Any) -> Any:
    """The same value of Python's own types, whose text keeps every digit."""
    if isinstance(value, Mapping):
        return {str(name): _plain(entry) for name, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value


def literal(value: Any) -> str:
    """Return Python text of numbers, texts, and lists and tables of both."""
    return pformat(_plain(value), width=118, sort_dicts=False, compact=True)


def script(title: str, imports: str, constants: Mapping[str, Any], *code: str) -> str:
    """Return the text of a script: title, imports, data by names, code."""
    data = "\n".join(f"{name} = {literal(value)}" for name, value in constants.items())
    heading = title.replace("\\", "/").replace('"', "'")
    future = "from __future__ import annotations"  # sources of functions may have annotations of any names
    return f'"""{heading}"""\n\n{future}\n\n{imports.strip()}\n\n{data}\n' + "".join(f"\n{part}" for part in code)
