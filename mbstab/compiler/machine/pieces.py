"""One piece of machine code of many functions: only what Python calls is optimized and finished.

By default Numba optimizes and finishes each function with all that it calls, and then again with each of its callers.
Here the functions that Python does not call are parts: they are translated once, and stand in what calls them.
"""

from __future__ import annotations

from typing import Any

from numba import _dynfunc
from numba.core import config
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.typed_passes import NativeLowering


class _Part(JITCodeLibrary):  # type: ignore[misc]  # Numba has no types
    """A function with those that it calls, not optimized."""

    def finalize(self) -> None:
        """Take along the functions that are called."""
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True


class _Whole(JITCodeLibrary):  # type: ignore[misc]
    """What Python calls, with all its parts."""

    def _optimize_final_module(self) -> None:
        """Optimize everything together.

        Names of parts are hidden: parts of different pieces that are read from where they are kept may have the same.
        Loops are short here, so that vectors of numbers only make the code longer.
        """
        for function in self._final_module.functions:
            if function.linkage.name == "linkonce_odr" and not function.is_declaration:
                function.linkage = "internal"
        kept, config.LOOP_VECTORIZE = config.LOOP_VECTORIZE, 0
        try:
            super()._optimize_final_module()
        finally:
            config.LOOP_VECTORIZE = kept


@register_pass(mutates_CFG=True, analysis_only=False)
class _Lowering(NativeLowering):  # type: ignore[misc]
    """The step of Numba that writes machine code."""

    _name = "lowering_of_pieces"

    def run_pass(self, state: Any) -> bool:
        """Write the code of a part, or of a whole: what Python calls."""
        part, name = state.flags.no_cpython_wrapper, state.func_id.func_qualname
        state.library = (_Part if part else _Whole)(state.targetctx.codegen(), name)
        state.library.enable_object_caching()
        state.flags.no_compile = part
        super().run_pass(state)
        if part:
            found = state["cr"]
            # Callers know a function by this object, which cannot be called.
            key = _dynfunc.make_function(found.fndesc.lookup_module(), name, "", 0, found.env, (state.library,))
            state.targetctx.insert_user_function(key, found.fndesc, [state.library])
            state["cr"] = found._replace(cfunc=key)
        return True


class Pieces(CompilerBase):  # type: ignore[misc]
    """Numba's compiler with this step."""

    def define_pipelines(self) -> list[Any]:
        """Return the steps of the compiler."""
        manager = PassManager("pieces")
        for step, name in DefaultPassBuilder.define_nopython_pipeline(self.state).passes:
            manager.add_pass(_Lowering if step is NativeLowering else step, name)
        manager.finalize()
        return [manager]
