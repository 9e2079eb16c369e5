"""Read the part of a program that holds synchronized actions."""

import re

from turning_nc.expression import NUMBER, parse
from turning_nc.synchronous import (
    COMPARISONS,
    LOAD,
    READABLE,
    WRITABLE,
    Action,
    Assign,
    Condition,
    Evaluate,
    Law,
    Polynomial,
)

_SIGNED = rf"-?(?:{NUMBER})"
_INITIAL = re.compile(rf"(\$AC_PARAM\[\d\])=({_SIGNED})", re.ASCII)
_FCTDEF = re.compile(rf"FCTDEF\((\d{{1,3}}),({_SIGNED}(?:,{_SIGNED}){{5}})\)", re.ASCII)
_ACTION = re.compile(r"ID=(\d{1,3}) +(?:WHENEVER +(.+) +)?DO +(.+)", re.ASCII)
_SYNFCT = re.compile(r"SYNFCT\((\d{1,3}),([^,]+),([^,]+)\)", re.ASCII)
_CONDITION = re.compile(r"([^<>=]+)(<=|>=|<|>)([^<>=]+)", re.ASCII)


class LawReader:
    """A reader that takes a law's blocks in the subset's order: first values, polynomials, actions."""

    def __init__(self) -> None:
        self._stopped = False
        self._initial: dict[str, float] = {}
        self._polynomials: dict[int, Polynomial] = {}
        self._actions: list[Action] = []

    def take(self, body: str) -> bool:
        """Take a block; return whether it is part of a law.

        Raises:
            ValueError: the block is part of a law, but not in the subset or not allowed here.
        """
        if body == "STOPRE":
            if self._stopped or self._polynomials or self._actions:
                raise ValueError("STOPRE must stand once, before the first values")
            self._stopped = True
        elif body.startswith("$"):
            self._first_value(body)
        elif body.startswith("FCTDEF"):
            self._polynomial(body)
        elif body.startswith("ID"):
            self._action(body)
        else:
            return False
        return True

    def check(self) -> None:
        """Check that actions use the first values and polynomials.

        Raises:
            ValueError: there are polynomials or first values, but no actions.
        """
        if not self._actions and (self._stopped or self._initial or self._polynomials):
            raise ValueError("there are first values or polynomials, but no synchronized action uses them")

    def law(self) -> Law | None:
        """Return the law that has been read, if any."""
        if not self._actions:
            return None
        return Law(tuple(self._polynomials.values()), tuple(self._initial.items()), tuple(self._actions))

    def _first_value(self, body: str) -> None:
        match = _INITIAL.fullmatch(body)
        if match is None:
            raise ValueError(f"{body!r} is not a first value such as $AC_PARAM[0]=100.0")
        if not self._stopped or self._polynomials or self._actions:
            raise ValueError("first values must stand between STOPRE and the polynomials")
        if match[1] in self._initial:
            raise ValueError(f"{match[1]} has a first value already")
        self._initial[match[1]] = float(match[2])

    def _polynomial(self, body: str) -> None:
        match = _FCTDEF.fullmatch(body)
        if match is None:
            raise ValueError(f"{body!r} is not FCTDEF(number,lower limit,upper limit,a0,a1,a2,a3)")
        if self._actions:
            raise ValueError("polynomials must stand before the synchronized actions")
        number = int(match[1])
        low, high, a0, a1, a2, a3 = map(float, match[2].split(","))
        if number in self._polynomials:
            raise ValueError(f"polynomial {number} is defined already")
        if low > high:
            raise ValueError(f"the lower limit of polynomial {number} is {low}, above the upper one, {high}")
        self._polynomials[number] = Polynomial(number, low, high, (a0, a1, a2, a3))

    def _action(self, body: str) -> None:
        match = _ACTION.fullmatch(body)
        if match is None:
            raise ValueError(f"{body!r} is not ID=number DO ... or ID=number WHENEVER ... DO ...")
        number = int(match[1])
        if self._actions and number <= self._actions[-1].number:
            raise ValueError(f"ID={number} must stand before ID={self._actions[-1].number}: actions run in this order")
        self._actions.append(Action(number, _conditions(match[2]), self._effect(match[3].strip())))

    def _effect(self, text: str) -> Evaluate | Assign:
        if text.startswith("SYNFCT"):
            match = _SYNFCT.fullmatch(text)
            if match is None:
                raise ValueError(f"{text!r} is not SYNFCT(polynomial,output,input)")
            number = int(match[1])
            if number not in self._polynomials:
                raise ValueError(f"polynomial {number} is not defined")
            if match[3] != LOAD:
                raise ValueError(f"SYNFCT reads {match[3]}, but may read {LOAD} alone")
            return Evaluate(number, _writable(match[2]), match[3])
        output, equals, expression = text.partition("=")
        if not equals:
            raise ValueError(f"{text!r} is neither SYNFCT nor an assignment")
        return Assign(_writable(output), parse(expression, READABLE))


def _conditions(text: str | None) -> tuple[Condition, ...]:
    if text is None:
        return ()
    parts = text.split(" AND ")
    if len(parts) > 1:
        for part in parts:
            if not (part.strip().startswith("(") and part.strip().endswith(")")):
                raise ValueError(f"{part.strip()!r} must stand in parentheses, as AND joins it")
        parts = [part.strip()[1:-1] for part in parts]
    return tuple(_condition(part) for part in parts)


def _condition(text: str) -> Condition:
    match = _CONDITION.fullmatch(text.strip())
    if match is None:
        raise ValueError(f"{text!r} is not a variable compared, by {', '.join(COMPARISONS)}, with a number or a variable")
    if match[1].strip() not in READABLE:
        raise ValueError(f"{match[1].strip()!r} cannot be compared, only {', '.join(READABLE)}")
    return Condition(match[1].strip(), match[2], parse(match[3], READABLE))


def _writable(name: str) -> str:
    if name not in WRITABLE:
        raise ValueError(f"{name!r} cannot be written, only {', '.join(WRITABLE)}")
    return name
