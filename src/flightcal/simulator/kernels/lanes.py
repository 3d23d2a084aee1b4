"""A number with eight lanes: the same compiled source runs one simulation, or eight side by side.

A `Lanes` value holds one double of each of eight simulations, in one vector register of the processor (or in several
where registers are shorter). Memory is an array of doubles: [m] for a single simulation, [m, 8] for eight. What
`elements` makes of either is indexed and reckoned with alike, x[i] = 2 * y[i] + z[i], while `take` and `put` reach a
single lane. Which of the two a function is compiled for follows from the memory that it is given.
"""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, overload, register_model

WIDTH = 8
_ALIGNMENT = 64  # bytes

_DOUBLE = ir.DoubleType()
VECTOR = ir.VectorType(_DOUBLE, WIDTH)


def lane_memory(size: int) -> Any:
    """Memory [size, 8] for eight simulations, aligned as vector registers want it."""
    return aligned(size * WIDTH).reshape(size, WIDTH)


def aligned(size: int, at: int = 0) -> Any:
    """Memory [size] whose number `at` is where vector registers want it."""
    raw = np.empty(size + _ALIGNMENT // 8)
    begin = (-raw.ctypes.data // 8 - at) % (_ALIGNMENT // 8)
    return raw[begin : begin + size]


# --- what compiled functions call ---------------------------------------------------------------------------


def lane_count(memory: Any) -> int:
    """1 for memory [m], 8 for memory [m, 8]."""
    raise NotImplementedError


def elements(memory: Any) -> Any:
    """Memory as a sequence of doubles or of `Lanes`; the memory must outlive it."""
    raise NotImplementedError


def take(sequence: Any, i: int, lane: int) -> float:
    """One lane of element i."""
    raise NotImplementedError


def put(sequence: Any, i: int, lane: int, value: float) -> None:
    """Set one lane of element i."""
    raise NotImplementedError


# --- what Numba needs to know of the two types --------------------------------------------------------------


class _LanesType(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"Lanes({WIDTH})")


class _SequenceType(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"LaneSequence({WIDTH})")


LANES = _LanesType()
_SEQUENCE = _SequenceType()
_PLACE = types.UniTuple(types.intp, 2)


@register_model(_LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


@register_model(_SequenceType)
class _SequenceModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR.as_pointer())


def _spread(builder: Any, value: Any) -> Any:
    """A vector whose lanes all hold a double."""
    empty = ir.Constant(VECTOR, ir.Undefined)
    first = builder.insert_element(empty, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, empty, ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH))


def _register_arithmetic(function: Any, instruction: str) -> None:
    @infer_global(function)
    class _Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if LANES in args and all(kind == LANES or isinstance(kind, types.Number) for kind in args):
                return signature(LANES, *(kind if kind == LANES else types.float64 for kind in args))
            return None

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        left, right = (
            value if kind == LANES else _spread(builder, value) for value, kind in zip(args, sig.args, strict=True)
        )
        return getattr(builder, instruction)(left, right)

    for kinds in ((LANES, LANES), (LANES, types.float64), (types.float64, LANES)):
        lower_builtin(function, *kinds)(generate)


for _function, _instruction in (
    (operator.add, "fadd"), (operator.iadd, "fadd"), (operator.sub, "fsub"), (operator.isub, "fsub"),
    (operator.mul, "fmul"), (operator.imul, "fmul"), (operator.truediv, "fdiv"), (operator.itruediv, "fdiv"),
):  # fmt: skip
    _register_arithmetic(_function, _instruction)


@infer_global(operator.getitem)
class _Get(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        sequence, index = args
        if sequence == _SEQUENCE and isinstance(index, types.Integer):
            return signature(LANES, sequence, index)
        if sequence == _SEQUENCE and isinstance(index, types.BaseTuple):
            return signature(types.float64, sequence, _PLACE)
        return None


@infer_global(operator.setitem)
class _Set(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        sequence, index, value = args
        if sequence == _SEQUENCE and isinstance(index, types.Integer):
            return signature(types.none, sequence, index, value if value == LANES else types.float64)
        if sequence == _SEQUENCE and isinstance(index, types.BaseTuple):
            return signature(types.none, sequence, _PLACE, types.float64)
        return None


@lower_builtin(operator.getitem, _SEQUENCE, types.Integer)
def _get_lanes(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    loaded = builder.load(builder.gep(args[0], [args[1]]))
    loaded.align = _ALIGNMENT
    return loaded


@lower_builtin(operator.setitem, _SEQUENCE, types.Integer, LANES)
@lower_builtin(operator.setitem, _SEQUENCE, types.Integer, types.float64)
def _set_lanes(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    value = args[2] if sig.args[2] == LANES else _spread(builder, args[2])
    stored = builder.store(value, builder.gep(args[0], [args[1]]))
    stored.align = _ALIGNMENT
    return context.get_dummy_value()


def _address(builder: Any, pointer: Any, place: Any) -> Any:
    """Of one lane of one element."""
    i, lane = builder.extract_value(place, 0), builder.extract_value(place, 1)
    offset = builder.add(builder.mul(i, ir.Constant(i.type, WIDTH)), lane)
    return builder.gep(builder.bitcast(pointer, _DOUBLE.as_pointer()), [offset])


@lower_builtin(operator.getitem, _SEQUENCE, _PLACE)
def _get_lane(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.load(_address(builder, *args))


@lower_builtin(operator.setitem, _SEQUENCE, _PLACE, types.float64)
def _set_lane(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    builder.store(args[2], _address(builder, args[0], args[1]))
    return context.get_dummy_value()


@intrinsic
def _sequence(typing_context: Any, memory: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        view = context.make_array(sig.args[0])(context, builder, args[0])
        return builder.bitcast(view.data, VECTOR.as_pointer())

    return _SEQUENCE(memory), generate


# An implementation's signature must be its overload's, annotations included, and a lambda has none.


@overload(lane_count, jit_options={"forceinline": True})
def _lane_count(memory):
    if memory.ndim == 1:
        return lambda memory: 1
    return lambda memory: WIDTH


@overload(elements, jit_options={"forceinline": True})
def _elements(memory):
    if memory.ndim == 1:
        return lambda memory: memory
    return lambda memory: _sequence(memory)


@overload(take, jit_options={"forceinline": True})
def _take(sequence, i, lane):
    if sequence == _SEQUENCE:
        return lambda sequence, i, lane: sequence[i, lane]
    return lambda sequence, i, lane: sequence[i]


@overload(put, jit_options={"forceinline": True})
def _put(sequence, i, lane, value):
    def into_lane(sequence, i, lane, value):
        sequence[i, lane] = value

    def into_double(sequence, i, lane, value):
        sequence[i] = value

    return into_lane if sequence == _SEQUENCE else into_double
