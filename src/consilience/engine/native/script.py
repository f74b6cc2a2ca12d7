"""Pieces of runnable scripts: numbers with all their digits, and functions of the elements."""

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
"""Source of a function that evaluates what `function_data` gives; a script that has it imports math."""


def function_data(function: Function) -> dict[str, Any]:
    """Numbers of a function: coefficients, sines, and each piece of its curve."""
    table = function.table
    return {
        "polynomial": function.polynomial,
        "harmonics": function.harmonics,
        "pieces": [] if table is None else table.pieces,
        "periodic": table is not None and table.periodic,
    }


def _plain(value: Any) -> Any:
    """The same of Python's own types, whose text gives back every digit."""
    if isinstance(value, Mapping):
        return {str(name): _plain(entry) for name, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value


def literal(value: Any) -> str:
    """Text in Python of numbers, texts, lists and tables of them."""
    return pformat(_plain(value), width=118, sort_dicts=False, compact=True)


def script(title: str, imports: str, constants: Mapping[str, Any], *code: str) -> str:
    """Text of a script: what it is, imports, data by names, code."""
    data = "\n".join(f"{name} = {literal(value)}" for name, value in constants.items())
    heading = title.replace("\\", "/").replace('"', "'")
    return f'"""{heading}"""\n\n{imports.strip()}\n\n{data}\n' + "".join(f"\n{part}" for part in code)
