"""Parameters of a block of environments: the same for all, or some of them a number for each environment.

``at(parameters, i)`` gives the parameters of environment i, read as ``p.power_limit``. If all environments share them, it is the
record itself, at no cost. Otherwise the record has a field ``rows``, which covers its numbers for each environment, shape
(numbers, environments); other fields are shared.
"""

from typing import Any

import numpy as np
from numba import types
from numba.core.cgutils import create_struct_proxy, get_record_member
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic, lower_getattr_generic, models, overload, register_model

ROWS = "rows"
INLINED: Any = {"forceinline": True, "no_cfunc_wrapper": True}
"""Options of overloads that are compiled into their callers."""


class Lane:
    """The parameters of environment ``index`` of a block, interpreted."""

    def __init__(self, block: Any, index: int, width: int) -> None:
        self._block, self._index, self._width = block, index, width

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._block, name)
        if isinstance(value, np.record):
            return Lane(value, self._index, self._width)
        return value[self._index] if np.shape(value) == (self._width,) else value


def at(parameters, i):
    """Return the parameters of environment i of a block."""
    if isinstance(parameters, Lane):
        return Lane(parameters._block, i, parameters._width)
    return Lane(parameters, i, parameters[ROWS].shape[-1]) if ROWS in parameters.dtype.names else parameters


class _LaneType(types.Type):
    """The type of a ``Lane``. Its name, which also names machine code, does not depend on the process."""

    def __init__(self, record: Any, width: int) -> None:
        self.record, self.width = record, width
        super().__init__(f"Lane({width},{record.size})")

    @property
    def key(self) -> Any:
        return self.record, self.width


@register_model(_LaneType)
class _LaneModel(models.StructModel):
    def __init__(self, manager: Any, lane: Any) -> None:
        super().__init__(manager, lane, [("block", types.voidptr), ("index", types.intp)])


def _lane(context: Any, builder: Any, lane: Any, block: Any, index: Any) -> Any:
    made = create_struct_proxy(lane)(context, builder)
    made.block, made.index = builder.bitcast(block, made.block.type), index
    return made._getvalue()


@infer_getattr
class _LaneAttributes(AttributeTemplate):
    key = _LaneType

    def generic_resolve(self, lane: Any, name: str) -> Any:  # type: ignore[override]
        """Return the type of an attribute."""
        field = lane.record.typeof(name)
        if isinstance(field, types.Record):
            return _LaneType(field, lane.width)
        return field.dtype if isinstance(field, types.NestedArray) and field.shape == (lane.width,) else field


@lower_getattr_generic(_LaneType)  # type: ignore[untyped-decorator]
def _read(context: Any, builder: Any, lane: Any, value: Any, name: str) -> Any:
    parts = create_struct_proxy(lane)(context, builder, value)
    block = builder.bitcast(parts.block, context.get_value_type(lane.record))
    field, offset = lane.record.typeof(name), lane.record.offset(name)
    if isinstance(field, types.Record):
        inner = get_record_member(builder, block, offset, context.get_data_type(field))
        return _lane(context, builder, _LaneType(field, lane.width), inner, parts.index)
    if not isinstance(field, types.NestedArray) or field.shape != (lane.width,):
        return context.get_getattr(lane.record, name)(context, builder, lane.record, block, name)
    first = get_record_member(builder, block, offset, context.get_data_type(field.dtype))
    return builder.load(builder.gep(first, [parts.index]))


@intrinsic
def _lane_of(typing_context: Any, parameters: Any, index: Any) -> Any:
    lane = parameters if isinstance(parameters, _LaneType) else _LaneType(parameters, parameters.typeof(ROWS).shape[-1])

    def make(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        block = values[0]
        if isinstance(signature.args[0], _LaneType):
            block = create_struct_proxy(lane)(context, builder, block).block
        return _lane(context, builder, lane, block, values[1])

    return lane(parameters, types.intp), make


@overload(at, jit_options=INLINED)
def _at(parameters, i):
    if isinstance(parameters, _LaneType) or ROWS in parameters.fields:
        return lambda parameters, i: _lane_of(parameters, i)  # type: ignore[call-arg]
    return lambda parameters, i: parameters
