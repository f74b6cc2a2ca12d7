"""Inner kernels: only LLVM bitcode is kept; machine code is generated in their callers.

Numba optimises every kernel with all kernels that it calls, and generates machine code, which is never run for a kernel
that Python does not call: the callers take its bitcode, and optimise and translate it again.
"""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


class _NoMachineCode:
    """Code generator of an inner kernel, which has no machine code whose environment could be set."""

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: the callers have environments of their own."""


class InnerLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Bitcode of a kernel and of the kernels that it calls."""

    codegen = _NoMachineCode()

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return zero, which means no machine code to Numba."""
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> Any:
        """Return bitcode for the cache."""
        return self.serialize_using_bitcode()


class InnerCompiler(Compiler):  # type: ignore[misc]
    """Numba's compiler up to bitcode."""

    def define_pipelines(self) -> list[Any]:
        """Return the usual passes, with an `InnerLibrary`."""
        self.state.library = InnerLibrary(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()
