"""Native models: texts of runnable scripts for an engine alone, and parts of models of other formats."""

from consilience.engine.native.elements import (
    ELEMENTS,
    LAWS,
    ROLLING,
    ROWS,
    SOLVE,
    Places,
    element_data,
    refuse_contacts,
    row_data,
)
from consilience.engine.native.parts import CoordinateLaw, NativeJoint, Notes, Parts, Piece
from consilience.engine.native.script import JET, function_data, literal, script

__all__ = [
    "ELEMENTS",
    "JET",
    "LAWS",
    "ROLLING",
    "ROWS",
    "SOLVE",
    "CoordinateLaw",
    "NativeJoint",
    "Notes",
    "Parts",
    "Piece",
    "Places",
    "element_data",
    "function_data",
    "literal",
    "refuse_contacts",
    "row_data",
    "script",
]
