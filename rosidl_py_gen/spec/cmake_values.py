"""Variables of a CMake run of which not everything is known.

A variable has one value for each way the build may have gone; where a piece of text cannot be known, the value has
`UNKNOWN` in its place. The package folder is called `ROOT`, so that no path of this machine gets into a value.
What a hostile file can make this cost is counted in characters, by `Meter`.
"""

from __future__ import annotations

import posixpath
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rosidl_py_gen.spec.cmake_text import Argument, UnreadableError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

UNKNOWN = "\0"
ROOT = "/\1"
MOST_VALUES = 16
_MOST_CHARACTERS = 4_000_000  # about a second of work; real files need a tenth at most
_MOST_LENGTH = 1 << 18  # of one value

# The values a variable may have; None: it may be undefined.
Value = tuple[str | None, ...]
UNDEFINED: Value = (None,)
UNKNOWN_VALUE: Value = (UNKNOWN,)

_SPECIAL = re.compile(r"[$\\]")
_PIECE = re.compile(r"\$(?:ENV|CACHE)?\{|\$<|\}|\\(.)|[^\\$}]+|.", re.DOTALL)
_SEPARATOR = re.compile(r"(?<!\\);")
_ESCAPED = {"n": "\n", "t": "\t", "r": "\r", ";": "\\;", "\n": ""}
# What is the same in every ROS 2 build.
_ENVIRONMENT = {"ROS_VERSION": "2"}
_PLAIN_REGEX = re.compile(r"(?:[\w/ :;-]|\\\\?[.+*-]|\.[*+]?|\[\^?[\w./-]+\][*+]?|[\^$|()](?![*+?]))*\Z", re.ASCII)


class Meter:
    """How much work a file may still cause."""

    def __init__(self, characters: int = _MOST_CHARACTERS) -> None:
        self.left = characters

    def spend(self, characters: int) -> None:
        """Raises `UnreadableError` when the file has caused too much."""
        self.left -= characters + 20
        if self.left < 0:
            raise UnreadableError("it takes too many steps")


@dataclass(slots=True)
class State:
    """The variables at one point of a run: one frame a scope, the innermost last; a frame has all that is visible.

    Attributes:
        frames: variables by name.
        own: names the file sets somewhere; before that they are undefined. What it never sets may come from CMake,
            from a package or from the user: unknown.
    """

    own: set[str]
    frames: list[dict[str, Value]] = field(default_factory=lambda: [{}])

    def get(self, name: str) -> Value:
        found = self.frames[-1].get(name)
        return found if found is not None else UNDEFINED if name in self.own else UNKNOWN_VALUE

    def set(self, name: str, values: Iterable[str | None], outside: bool = False) -> None:
        """Set a variable; with `outside` that of the scope around this one, if it has one."""
        few = tuple(dict.fromkeys(values))
        if outside and len(self.frames) == 1:
            return
        self.frames[-2 if outside else -1][name] = few if len(few) <= MOST_VALUES else UNKNOWN_VALUE

    def fork(self, meter: Meter) -> State:
        meter.spend(20 * sum(map(len, self.frames)))
        return State(self.own, [dict(frame) for frame in self.frames])


def join(states: Sequence[State | None], meter: Meter) -> State | None:
    """What holds when the run took one of several ways; None stands for a way that ends before."""
    alive = [state for state in states if state is not None]
    if len(alive) < 2:
        return alive[0] if alive else None
    joined = alive[0].fork(meter)
    for other in alive[1:]:
        meter.spend(20 * sum(map(len, other.frames)))
        for depth, frame in enumerate(joined.frames):
            theirs = other.frames[depth]
            for name in frame.keys() | theirs.keys():
                missing = UNDEFINED if name in joined.own else UNKNOWN_VALUE
                values = tuple(dict.fromkeys((*frame.get(name, missing), *theirs.get(name, missing))))
                frame[name] = values if len(values) <= MOST_VALUES else UNKNOWN_VALUE
    return joined


def expand(argument: Argument, state: State, meter: Meter) -> tuple[str, ...]:
    """The texts an argument may stand for, with its references replaced."""
    if argument.kind == "bracket" or not _SPECIAL.search(argument.text):
        meter.spend(len(argument.text))
        return (argument.text,)
    opened: list[tuple[str, tuple[str, ...]]] = [("", ("",))]  # ${ and what came after it so far
    for piece in _PIECE.finditer(argument.text):
        text = piece[0]
        if text == "}" and len(opened) > 1:
            opening, names = opened.pop()
            found = tuple(dict.fromkeys(value for name in names for value in _referred(opening, name, state)))
        elif text.startswith("$") and text.endswith("{"):
            if len(opened) > 10:
                raise UnreadableError("references are nested too deeply", argument.offset)
            opened.append((text, ("",)))
            continue
        else:
            found = (UNKNOWN if text == "$<" else _ESCAPED.get(piece[1], piece[1]) if piece[1] else text,)
        opened[-1] = (opened[-1][0], combine(opened[-1][1], found, "", meter))
    if len(opened) > 1:
        raise UnreadableError("a reference is not closed", argument.offset)
    return opened[0][1]


def _referred(opening: str, name: str, state: State) -> tuple[str, ...]:
    if UNKNOWN in name:
        return (UNKNOWN,)
    if opening == "${":
        return tuple(value or "" for value in state.get(name))
    return (_ENVIRONMENT.get(name, UNKNOWN) if opening == "$ENV{" else UNKNOWN,)


def combine(left: tuple[str, ...], right: tuple[str, ...], between: str, meter: Meter) -> tuple[str, ...]:
    """Every left text with every right text behind it; `between` is left out beside an empty text."""
    if len(left) * len(right) > MOST_VALUES:
        return (UNKNOWN,)
    meter.spend(sum(map(len, left)) * len(right) + sum(map(len, right)) * len(left))
    if max(map(len, left)) + max(map(len, right)) > _MOST_LENGTH:
        raise UnreadableError(f"a text is longer than {_MOST_LENGTH} characters")
    return tuple(dict.fromkeys(a + between + b if a and b else a + b for a in left for b in right))


def items(text: str) -> list[str]:
    """The elements of a list, empty ones left out."""
    return [item for item in _SEPARATOR.split(text) if item]


def inside(path: str, folder: str = ROOT) -> str | None:
    """The absolute form of a path in the package; None when it lies elsewhere or cannot be known."""
    whole = posixpath.normpath(posixpath.join(folder, path))
    return whole if UNKNOWN not in whole and (whole == ROOT or whole.startswith(ROOT + "/")) else None


def matches(regex: str, text: str, meter: Meter) -> bool | None:
    """Whether a CMake regular expression is found in a text.

    None unless the expression cannot run away and means the same in Python.
    """
    loops = sum(map(regex.count, "*+"))
    if len(regex) > 200 or len(text) > 200 or loops > 2 or not _PLAIN_REGEX.match(regex):
        return None
    meter.spend(len(text) ** (loops + 1) // 20)
    try:
        return re.search(regex, text) is not None
    except re.error:
        return None
