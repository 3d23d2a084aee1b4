"""Eight doubles of an array at once, as a `Lanes` value: neighbours, not simulations."""

from __future__ import annotations

from typing import Any

from numba.core import types
from numba.extending import intrinsic

from .lanes import LANES, VECTOR


def _address(context: Any, builder: Any, kind: Any, array: Any, at: Any) -> Any:
    view = context.make_array(kind)(context, builder, array)
    return builder.bitcast(builder.gep(view.data, [at]), VECTOR.as_pointer())


@intrinsic
def eight(typing_context: Any, array: Any, at: Any) -> Any:
    """array[at : at + 8]."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        loaded = builder.load(_address(context, builder, sig.args[0], *args))
        loaded.align = 8
        return loaded

    return LANES(array, types.intp), generate


@intrinsic
def set_eight(typing_context: Any, array: Any, at: Any, value: Any) -> Any:
    """array[at : at + 8] = value."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        array, at, value = args
        stored = builder.store(value, _address(context, builder, sig.args[0], array, at))
        stored.align = 8
        return context.get_dummy_value()

    return types.none(array, types.intp, LANES), generate
