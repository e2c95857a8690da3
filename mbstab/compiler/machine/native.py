"""Machine code by Numba: what is compiled, where it is kept, and how far it is; arrays of a machine as they stand."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, TypeVar
from zlib import crc32

import numba
from numba.core import event, types
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from mbstab.compiler.machine.operations import REFUSED, TEXTS
from mbstab.compiler.machine.pieces import Pieces
from mbstab.compiler.machine.tables import Floats
from mbstab.compiler.trace import OPERATIONS

F = TypeVar("F", bound=Callable[..., object])


def version(folder: Path) -> str:
    """Return a name for the operations and for the modules in a folder that are compiled together.

    Numba keeps machine code by the name and the file of what Python calls, and sees no change elsewhere.
    """
    operations = repr([(name, TEXTS[name], REFUSED.get(name)) for name in OPERATIONS])
    files = sorted(folder.glob("*.py"))
    return f"{crc32(b''.join([operations.encode(), *(path.read_bytes() for path in files)])):08x}"


VERSION = version(Path(__file__).parent)


MADE: set[Callable[..., object]] = set()
"""Functions of this module that Numba compiles by themselves."""


def compiled(function: F) -> F:
    """Return a function in machine code, for others in machine code: what calls them takes their code along.

    It makes no arrays. Without Numba's counting of references (`_nrt`) calls with as many arrays as here take a third
    of the time. Python must not call it.
    """
    MADE.add(function)
    result: F = _translated(function, no_cpython_wrapper=True)
    return result


def called(function: F) -> F:
    """Return a function in machine code that Python calls; Numba keeps it beside the file in which it stands."""
    MADE.add(function)
    function.__qualname__ += f"_{VERSION}"
    result: F = _translated(function, cache=True)
    return result


def _translated(function: F, **options: bool) -> Any:
    return numba.njit(
        pipeline_class=Pieces, no_cfunc_wrapper=True, error_model="numpy", nogil=True, _nrt=False, **options
    )(function)


class _Teller(event.Listener):  # type: ignore[misc]  # Numba has no types
    """Tells how many of the functions of this module are compiled, if they are not read from where they are kept."""

    def __init__(self, tell: Callable[[float], object]) -> None:
        self._tell, self._left = tell, {*MADE}
        self._all, self._begun = len(MADE), False

    def on_start(self, event: event.Event) -> None:
        """Tell at the first time."""
        if not self._begun and event.data["dispatcher"].py_func in self._left:
            self._begun = True
            self._tell(0.0)

    def on_end(self, event: event.Event) -> None:
        """Tell what part is done."""
        if self._begun and (function := event.data["dispatcher"].py_func) in self._left:
            self._left.remove(function)
            self._tell(1.0 - len(self._left) / self._all)


def telling(tell: Callable[[float], object]) -> AbstractContextManager[object]:
    """Return a context in which a function is called with the part that is compiled, if that has to be done."""
    context: AbstractContextManager[object] = event.install_listener("numba:compile", _Teller(tell))
    return context


def _view(kind: Any, own: Any, place: int) -> Callable[..., Any]:
    """Return a function that is given a machine and the number of a table, and returns the table as it stands there.

    Nothing is called or counted, which is why arrays may be returned. A slice means the same, but Numba takes ten
    times as long to compile it.

    Parameters
    ----------
    kind, own : types of Numba
        Of the numbers, and of those of which the table consists; one of the first may be several of the second.
    place : int
        Of the array in a machine.
    """
    array, table = types.Array(kind, 1, "C"), types.Array(own, 1, "C")

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        m, name = arguments
        make = context.make_array
        places = make(types.Array(types.int64, 1, "C"))(context, builder, builder.extract_value(m, 0)).data
        whole = make(table)(context, builder, builder.extract_value(m, place))
        start, stop = (builder.load(builder.gep(places, [builder.add(name, name.type(k))])) for k in range(2))
        view = make(array)(context, builder)
        size = context.get_abi_sizeof(context.get_data_type(kind))
        count = builder.sdiv(builder.sub(stop, start), name.type(kind.bitwidth // own.bitwidth))
        data = builder.bitcast(builder.gep(whole.data, [start]), view.data.type)
        item = name.type(size)
        populate_array(view, data, [count], [item], item, meminfo=None)
        return view._getvalue()

    return lambda context, m, name: (array(m, types.int64), code)


integers = intrinsic(_view(types.int64, types.int64, 0))
"""Returns a table of integers of a machine."""

floats = intrinsic(_view(types.float64, types.float64, 1))
"""Returns a table of floats of a machine."""

complexes = intrinsic(_view(types.complex128, types.float64, 1))
"""Returns a table of floats of a machine, as complex numbers."""


@compiled
def fill(x: Floats, value: float) -> None:
    """Set all of x; for short arrays several times as fast as a slice."""
    for i in range(len(x)):
        x[i] = value


@compiled
def copy(x: Floats, y: Floats) -> None:
    """Set x to y."""
    for i in range(len(x)):
        x[i] = y[i]
