"""Kernels that only kernels call: what Numba does for them is left to those that Python calls.

Numba optimises every kernel, with all that it calls, and makes machine code of it, which nobody runs where Python does
not call it: its callers take its instructions, and optimise and translate them once more. Here an inner kernel is left
at its instructions. They are optimised where they end up.
"""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


class _NoMachineCode:
    """Of an inner kernel: its codegen, which has no machine code to tell of its environment."""

    def set_env(self, name: str, environment: Any) -> None:
        """Nothing: callers have an environment of their own."""


class InnerLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Instructions of a kernel and of those that it calls, for its callers."""

    codegen = _NoMachineCode()

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Zero, which to Numba is no machine code."""
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> Any:
        """What the cache keeps: instructions."""
        return self.serialize_using_bitcode()


class InnerCompiler(Compiler):  # type: ignore[misc]
    """Numba's compiler, up to the instructions."""

    def define_pipelines(self) -> list[Any]:
        """The usual passes, into a library of ours."""
        self.state.library = InnerLibrary(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()
