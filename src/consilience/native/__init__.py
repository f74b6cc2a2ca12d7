"""Native models: what an adapter builds, written so that a user goes on with the engine alone."""

from __future__ import annotations

from consilience.native.elements import ELEMENTS, ROWS, SOLVE, Places, element_data, row_data
from consilience.native.files import exporter, native_files, write_native
from consilience.native.script import JET, function_data, literal, script

__all__ = [
    "ELEMENTS",
    "JET",
    "ROWS",
    "SOLVE",
    "Places",
    "element_data",
    "exporter",
    "function_data",
    "literal",
    "native_files",
    "row_data",
    "script",
    "write_native",
]
