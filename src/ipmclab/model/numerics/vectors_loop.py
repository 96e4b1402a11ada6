"""Sixteen numbers side by side in one variable of a kernel.

A compiler makes vector operations of a loop over arrays only where it can prove that the arrays are apart and where the
loop is long; of the small matrices of a strip it makes few. A value of the type ``Sixteen`` is a vector whatever stands
around it. It is LLVM's own type, so that every processor has it: what does not fit into a register is split.

Numbers are loaded from and stored at places behind the begin of an array, which a kernel asks for once: where an array
is handed from function to function its holders are counted, which takes longer than a small sum. Whoever called the
kernel holds the arrays.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from decimal import Context
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import extending, types
from numba.core import cgutils
from numba.np import arrayobj

from ipmclab.model.numerics.compiled import part

_numba: Any = extending  # its types are made at run time: no type checker knows them
_types: Any = types
_cgutils: Any = cgutils
_arrays: Any = arrayobj

WIDTH: Final = 16
"""Two vectors of the widest processors, so that one goes on while the other waits."""

SQUARE: Final = 8
"""Rows and columns of what is ``turned``."""

_LINE: Final = 64  # bytes

_VECTOR: Final = ir.VectorType(ir.DoubleType(), WIDTH)
_WHOLE: Final = ir.VectorType(ir.IntType(64), WIDTH)
_BEGIN: Final = _types.CPointer(_types.float64)


def filled(count: int) -> int:
    """A count filled up to whole vectors."""
    return -(-count // WIDTH) * WIDTH


def on_lines(*shapes: tuple[int, ...]) -> tuple[npt.NDArray[np.float64], ...]:
    """Arrays of zeros, each of which begins on a cache line.

    What lies across two lines takes twice as long to load.
    """
    line = _LINE // 8
    counts = [math.prod(shape) for shape in shapes]
    whole = np.zeros(sum(-(-count // line) * line for count in counts) + line)
    begin = (-whole.ctypes.data // whole.itemsize) % line
    found = []
    for shape, count in zip(shapes, counts, strict=True):
        found.append(whole[begin : begin + count].reshape(shape))
        begin += -(-count // line) * line
    return tuple(found)


class _Sixteen(_types.Type):  # type: ignore[misc]
    def __init__(self) -> None:
        super().__init__(name="Sixteen")


@_numba.register_model(_Sixteen)
class _SixteenModel(_numba.models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


_SIXTEEN: Final = _Sixteen()


def _operation(given: tuple[Any, ...], result: Any, build: Callable[..., Any]) -> Any:
    """A function of kernels, from what builds it of its arguments."""

    def typed(*_arguments: Any) -> Any:
        def generated(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            made = build(builder, *arguments)
            return context.get_dummy_value() if made is None else made

        return result(*given), generated

    # Numba counts arguments by their names: a function that takes any number of them will not do.
    names = [f"x{k}" for k in range(len(given))]
    made: dict[str, Any] = {"typed": typed}
    exec(f"def operation(typing, {', '.join(names)}): return typed(typing)", made)
    return _numba.intrinsic(made["operation"])


def _named(builder: Any, name: str, *arguments: Any) -> Any:
    """A call of a function that LLVM has for every vector."""
    kind = ir.FunctionType(_VECTOR, [_VECTOR] * len(arguments))
    function = _cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f64")
    return builder.call(function, arguments)


def _at(builder: Any, begin: Any, place: Any) -> Any:
    return builder.bitcast(builder.gep(begin, [place]), _VECTOR.as_pointer())


def _load(builder: Any, begin: Any, place: Any) -> Any:
    loaded = builder.load(_at(builder, begin, place))
    loaded.align = 8
    return loaded


def _store(builder: Any, begin: Any, place: Any, value: Any) -> None:
    builder.store(value, _at(builder, begin, place)).align = 8


def _alike(builder: Any, number: Any) -> Any:
    nothing = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(nothing, number, ir.IntType(32)(0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH))


def _all_below(builder: Any, x: Any, y: Any) -> Any:
    bits = builder.bitcast(builder.fcmp_ordered("<", x, y), ir.IntType(WIDTH))
    return builder.icmp_unsigned("==", bits, ir.Constant(bits.type, 2**WIDTH - 1))


def _doubled(builder: Any, x: Any, n: Any) -> Any:
    bits, times = builder.bitcast(x, _WHOLE), builder.bitcast(n, _WHOLE)
    moved = builder.shl(times, ir.Constant(_WHOLE, [52] * WIDTH))
    return builder.bitcast(builder.add(bits, moved), _VECTOR)


def _replaced(builder: Any, x: Any, place: Any, y: Any) -> Any:
    every = ir.VectorType(ir.IntType(32), WIDTH)
    nothing = ir.Constant(every, ir.Undefined)
    first = builder.insert_element(nothing, builder.trunc(place, ir.IntType(32)), ir.IntType(32)(0))
    here = builder.shuffle_vector(first, nothing, ir.Constant(every, [0] * WIDTH))
    return builder.select(builder.icmp_signed("==", here, ir.Constant(every, list(range(WIDTH)))), y, x)


@_numba.intrinsic  # type: ignore[untyped-decorator]
def begin_of(_typing: Any, array: Any) -> Any:
    """Where the numbers of an array begin, which has no gaps. Who called the kernel must hold the array."""
    if array.layout != "C" or array.dtype != _types.float64:
        return None

    def generated(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _arrays.make_array(signature.args[0])(context, builder, arguments[0]).data

    return _BEGIN(array), generated


@_numba.intrinsic  # type: ignore[untyped-decorator]
def on_cache_lines(_typing: Any) -> Any:
    """What the kernel around has no registers for begins on cache lines: half of the time of a load of it."""

    def generated(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        attributes = builder.function.attributes
        attributes.alignstack = _LINE
        attributes.add("nounwind")  # as all of Numba's are; without one that llvmlite lists it writes none
        return context.get_dummy_value()

    return _types.void(), generated


@_numba.intrinsic  # type: ignore[untyped-decorator]
def stays_apart(_typing: Any) -> Any:
    """The kernel around is made no part of others: what is seldom done takes no registers from what is done often."""

    def generated(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return _types.void(), generated


def _turned(builder: Any, begin: Any, place: Any, apart: Any, goal: Any, to: Any, goal_apart: Any) -> None:
    """Halves of the square change places, then halves of these, then halves of these."""
    eight = ir.VectorType(ir.DoubleType(), SQUARE)

    def row(begin: Any, place: Any, apart: Any, k: int) -> Any:
        there = builder.add(place, builder.mul(apart, apart.type(k)))
        return builder.bitcast(builder.gep(begin, [there]), eight.as_pointer())

    rows = []
    for k in range(SQUARE):
        rows.append(builder.load(row(begin, place, apart, k)))
        rows[k].align = 8
    for half in (1, 2, 4):
        low = [c - half + SQUARE if c & half else c for c in range(SQUARE)]
        high = [c + SQUARE if c & half else c + half for c in range(SQUARE)]
        masks = [ir.Constant(ir.VectorType(ir.IntType(32), SQUARE), places) for places in (low, high)]
        for k in range(SQUARE):
            if not k & half:
                pair = rows[k], rows[k + half]
                rows[k], rows[k + half] = (builder.shuffle_vector(*pair, mask) for mask in masks)
    for k in range(SQUARE):
        builder.store(rows[k], row(goal, to, goal_apart, k)).align = 8


behind = _operation((_BEGIN, _types.intp), _BEGIN, lambda builder, begin, place: builder.gep(begin, [place]))
"""(begin, place): the begin of what is from a place on."""

load = _operation((_BEGIN, _types.intp), _SIXTEEN, _load)
"""(begin, place): the sixteen numbers from a place on."""

store = _operation((_BEGIN, _types.intp, _SIXTEEN), _types.void, _store)
"""(begin, place, x): put x there."""

alike = _operation((_types.float64,), _SIXTEEN, _alike)
"""Sixteen times one number."""

plus = _operation((_SIXTEEN,) * 3, _SIXTEEN, lambda builder, x, y, z: _named(builder, "fmuladd", y, z, x))
"""(x, y, z): ``x + y z``, rounded once where the processor does that at once."""

less = _operation((_SIXTEEN,) * 3, _SIXTEEN, lambda builder, x, y, z: _named(builder, "fmuladd", builder.fneg(y), z, x))
"""(x, y, z): ``x - y z``"""

replaced = _operation((_SIXTEEN, _types.intp, _SIXTEEN), _SIXTEEN, _replaced)
"""(x, place, y): x, with that of y at one place."""

turned = _operation((_BEGIN, _types.intp, _types.intp) * 2, _types.void, _turned)
"""(begin, place, apart, goal, to, goal_apart): put a square of numbers elsewhere on its side, its rows so far apart."""

size = _operation((_SIXTEEN,), _SIXTEEN, lambda builder, x: _named(builder, "fabs", x))
"""Each without its sign."""

above = _operation(
    (_SIXTEEN,) * 4,
    _SIXTEEN,
    lambda builder, x, y, there, else_: builder.select(builder.fcmp_ordered(">", x, y), there, else_),
)
"""(x, y, there, otherwise): what is there where x > y."""

all_below = _operation((_SIXTEEN, _SIXTEEN), _types.boolean, _all_below)
"""Whether all x < y; false where one is no number."""

_doubled_by = _operation((_SIXTEEN, _SIXTEEN), _SIXTEEN, _doubled)


def _sign(sign: Callable[[Any, Any], Any], name: str) -> None:
    """A sign between two of them."""

    @_numba.type_callable(sign)  # type: ignore[untyped-decorator]
    def _typed(_context: Any) -> Any:
        return lambda x, y: _SIXTEEN if x is _SIXTEEN and y is _SIXTEEN else None

    @_numba.lower_builtin(sign, _SIXTEEN, _SIXTEEN)  # type: ignore[untyped-decorator]
    def _lowered(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return getattr(builder, name)(*arguments)


_sign(operator.add, "fadd")
_sign(operator.sub, "fsub")
_sign(operator.mul, "fmul")
_sign(operator.truediv, "fdiv")


# The logarithm of 2 as a number whose last bits are zero, so that its multiples are exact, and what is left of it.
_LN_2: Final = Context(prec=50).ln(2)
_HIGH: Final = float(np.round(math.log(2.0) * 2.0**32) / 2.0**32)
_LOW: Final = float(_LN_2 - Context(prec=50).create_decimal_from_float(_HIGH))
_PER_LN_2: Final = 1.0 / math.log(2.0)
_ROUNDING: Final = 1.5 * 2.0**52  # beside it a number keeps its whole part, in its last bits
_F3, _F4, _F5, _F6, _F7, _F8, _F9, _F10, _F11, _F12, _F13 = (1.0 / math.factorial(k) for k in range(3, 14))


@part
def exponential(x: Any) -> Any:
    """exp(x) to a few roundings; x beyond 700 either way counts as 700."""
    x = above(x, alike(700.0), alike(700.0), x)
    x = above(alike(-700.0), x, alike(-700.0), x)
    n = plus(alike(_ROUNDING), x, alike(_PER_LN_2))
    whole = n - alike(_ROUNDING)
    r = less(less(x, whole, alike(_HIGH)), whole, alike(_LOW))
    r2 = r * r
    r4 = r2 * r2
    first = plus(alike(1.0) + r, r2, plus(alike(0.5), r, alike(_F3)))
    second = plus(plus(alike(_F4), r, alike(_F5)), r2, plus(alike(_F6), r, alike(_F7)))
    third = plus(plus(alike(_F8), r, alike(_F9)), r2, plus(alike(_F10), r, alike(_F11)))
    fourth = plus(alike(_F12), r, alike(_F13))
    return _doubled_by(plus(first, r4, plus(second, r4, plus(third, r4, fourth))), n)
