"""Parameters of a block of environments: the same for all, or some of them a number for each.

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

from turning_env.numerics.compilation import INLINED

ROWS = "rows"


class PerEnv:
    """The parameters of environment ``index`` of a block, interpreted."""

    def __init__(self, block: Any, index: int, width: int) -> None:
        self._block, self._index, self._width = block, index, width

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._block, name)
        if isinstance(value, np.record):
            return PerEnv(value, self._index, self._width)
        return value[self._index] if np.shape(value) == (self._width,) else value


def at(parameters, i):
    """Return the parameters of environment i of a block."""
    if isinstance(parameters, PerEnv):
        return PerEnv(parameters._block, i, parameters._width)
    return PerEnv(parameters, i, parameters[ROWS].shape[-1]) if ROWS in parameters.dtype.names else parameters


class _PerEnvType(types.Type):
    """The type of a ``PerEnv``. Its name, which also names machine code, does not depend on the process."""

    def __init__(self, record: Any, width: int) -> None:
        self.record, self.width = record, width
        super().__init__(f"PerEnv({width},{record.size})")

    @property
    def key(self) -> Any:
        return self.record, self.width


@register_model(_PerEnvType)
class _PerEnvModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [("block", types.voidptr), ("index", types.intp)])


def _made(context: Any, builder: Any, kind: Any, block: Any, index: Any) -> Any:
    made = create_struct_proxy(kind)(context, builder)
    made.block, made.index = builder.bitcast(block, made.block.type), index
    return made._getvalue()


@infer_getattr
class _PerEnvAttributes(AttributeTemplate):
    key = _PerEnvType

    def generic_resolve(self, kind: Any, name: str) -> Any:  # type: ignore[override]
        """Return the type of an attribute."""
        field = kind.record.typeof(name)
        if isinstance(field, types.Record):
            return _PerEnvType(field, kind.width)
        return field.dtype if isinstance(field, types.NestedArray) and field.shape == (kind.width,) else field


@lower_getattr_generic(_PerEnvType)  # type: ignore[untyped-decorator]
def _read(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    parts = create_struct_proxy(kind)(context, builder, value)
    block = builder.bitcast(parts.block, context.get_value_type(kind.record))
    field, offset = kind.record.typeof(name), kind.record.offset(name)
    if isinstance(field, types.Record):
        inner = get_record_member(builder, block, offset, context.get_data_type(field))
        return _made(context, builder, _PerEnvType(field, kind.width), inner, parts.index)
    if not isinstance(field, types.NestedArray) or field.shape != (kind.width,):
        return context.get_getattr(kind.record, name)(context, builder, kind.record, block, name)
    first = get_record_member(builder, block, offset, context.get_data_type(field.dtype))
    return builder.load(builder.gep(first, [parts.index]))


@intrinsic
def _of_env(typing_context: Any, parameters: Any, index: Any) -> Any:
    kind = parameters if isinstance(parameters, _PerEnvType) else _PerEnvType(parameters, parameters.typeof(ROWS).shape[-1])

    def make(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        block = values[0]
        if isinstance(signature.args[0], _PerEnvType):
            block = create_struct_proxy(kind)(context, builder, block).block
        return _made(context, builder, kind, block, values[1])

    return kind(parameters, types.intp), make


@overload(at, jit_options=INLINED)
def _at(parameters, i):
    if isinstance(parameters, _PerEnvType) or ROWS in parameters.fields:
        return lambda parameters, i: _of_env(parameters, i)  # type: ignore[call-arg]
    return lambda parameters, i: parameters
