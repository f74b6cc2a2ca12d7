"""Native models: texts of runnable scripts for an engine alone, and parts of models of other formats."""

# mypy: implicit-reexport

from consilience.engine.native.elements import ELEMENTS, FRICTION, ROLLING, ROWS, SOLVE, Places, element_data, row_data
from consilience.engine.native.parts import CoordinateLaw, NativeJoint, Notes, Parts, Piece
from consilience.engine.native.script import JET, function_data, literal, script
