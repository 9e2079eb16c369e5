"""Damage to a file's content: to its bytes, or to what they say, so that it still is TOML, JSON or ONNX, but an odd one."""

import json
import tomllib
from collections.abc import Callable, Iterator, Sequence
from random import Random
from typing import Any

import onnx
import tomli_w

ODD = (b"", b"\0", b"\xff", b"\n", b'"', b"[" * 3_000, b"{", b"9" * 5_000, b"1e999", b"nan", b"-1", b"null", b"=", b",")
"""What readers tend to stumble over."""
_ODD_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2**31, 2**63, -(2**63), 10**400, 0.0, -0.0, 5e-324, 1e-12, 1.5, 1e308),
    *(float("nan"), float("inf"), "", "nan", "../x", "\0", "\ud800", "x" * 300, [], [[]], {}, {"": None}),
)
_ODD_WHOLE = (0, 1, -1, 2, 3, 7, 21, 65_537, 2**31 - 1, -(2**31), 2**32, 2**63 - 1, -(2**63))
_ODD_REAL = (0.0, -1.0, 1e30, float("nan"), float("inf"))


def damaged(content: bytes, random: Random, tokens: Sequence[bytes] = ()) -> bytes:
    """The content with one to four damages: bytes cut out, put in or doubled.

    Args:
        content: of a valid file.
        random: draws what is done, and where.
        tokens: words of the file's language, which are put in as often as what is odd.
    """
    for _ in range(random.randint(1, 4)):
        place = random.randint(0, len(content))
        end = min(place + random.choice((0, 0, 1, 1, 4, 40, len(content))), len(content))
        kind = random.randint(0, 2)
        if kind == 0:
            new = random.choice(tokens if tokens and random.random() < 0.5 else ODD)
        elif kind == 1:
            new = random.randbytes(random.randint(0, 6))
        else:
            start = random.randint(0, len(content))
            new = content[start : start + random.randint(0, 60)]
        content = content[:place] + new + content[end:]
    return content


def damaged_toml(content: bytes, random: Random) -> bytes:
    """TOML with one value that is odd, missing or elsewhere, if it was TOML; else damaged."""
    return _or_damaged(lambda: tomli_w.dumps(_changed(tomllib.loads(content.decode()), random)).encode(), content, random)


def damaged_json(content: bytes, random: Random) -> bytes:
    """JSON with one value that is odd, missing or elsewhere, if it was JSON; else damaged."""
    return _or_damaged(lambda: json.dumps(_changed(json.loads(content), random)).encode(), content, random)


def damaged_onnx(content: bytes, random: Random) -> bytes:
    """A network with one field that is odd, missing or there twice, if it was one; else damaged."""

    def changed() -> bytes:
        model = onnx.load_model_from_string(content)
        _change_message(random.choice(list(_messages(model))), random)
        return bytes(model.SerializeToString())

    return _or_damaged(changed, content, random)


def _or_damaged(change: Callable[[], bytes], content: bytes, random: Random) -> bytes:
    try:
        return change()
    except Exception:  # what cannot be read or written so: of many types
        return damaged(content, random)


def _changed(tree: Any, random: Random) -> Any:
    """The tree of tables and lists, in which one value is changed."""
    places = list(_places(tree))
    if not places:
        return random.choice(_ODD_VALUES)
    holder, key = random.choice(places)
    kind = random.randint(0, 4)
    if kind == 0:
        del holder[key]
    elif kind == 1:
        other, its = random.choice(places)
        holder[key] = json.loads(json.dumps(other[its]))  # a copy: a tree has no circles
    elif kind == 2 and isinstance(holder, dict):
        holder[random.choice([its for _, its in places if isinstance(its, str)])] = holder.pop(key)
    elif kind == 3 and isinstance(holder[key], int | float):
        holder[key] *= random.choice((-1, 0.5, 0.99, 1.01, 2, 10, 1e3, 1e9, 1e-9))
    else:
        holder[key] = random.choice(_ODD_VALUES)
    return tree


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every table or list with each of its keys or places."""
    keys = list(tree) if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else ()
    for key in keys:
        yield tree, key
        yield from _places(tree[key])


def _messages(message: Any) -> Iterator[Any]:
    """The message and all within it."""
    yield message
    for field, value in message.ListFields():
        if field.message_type is not None:
            for each in value if field.is_repeated else (value,):
                yield from _messages(each)


def _change_message(message: Any, random: Random) -> None:
    """Change one field, which may have been there or not."""
    present = [field for field, _ in message.ListFields()]
    field = random.choice(present if present and random.random() < 0.8 else message.DESCRIPTOR.fields)
    value = getattr(message, field.name)
    if not field.is_repeated:
        if field in present and random.random() < 0.2:
            message.ClearField(field.name)
        elif field.message_type is not None:
            value.SetInParent()
        else:
            setattr(message, field.name, _odd_scalar(field, value, random))
        return
    place = random.randrange(len(value)) if value else 0
    kind = random.randint(0, 3)
    if value and kind == 0:
        del value[place]
    elif field.message_type is not None:
        added = value.add()
        if len(value) > 1 and kind < 3:
            added.CopyFrom(value[place])
    elif value and kind == 1:
        value[place] = _odd_scalar(field, value[place], random)
    else:
        value.append(_odd_scalar(field, value[place] if value else None, random))


def _odd_scalar(field: Any, value: Any, random: Random) -> Any:
    """A value for a field of no message: odd, or made of the one that it has."""
    if field.cpp_type in (field.CPPTYPE_FLOAT, field.CPPTYPE_DOUBLE):
        return random.choice(_ODD_REAL)
    if field.cpp_type != field.CPPTYPE_STRING:
        return random.choice(_ODD_WHOLE)
    if field.type == field.TYPE_BYTES:
        return damaged(value or b"", random)
    if value and random.random() < 0.7:  # metadata are JSON
        return damaged_json(value.encode(), random).decode()
    return random.choice(
        ("", "If", "Loop", "Constant", "Reshape", "Expand", "observation", "memory", "action", "ai.onnx", "x" * 99)
    )
