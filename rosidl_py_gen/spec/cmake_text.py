"""The text of a CMakeLists.txt -> its commands, with if, foreach, function and macro as blocks.

Nothing is expanded or run here. The text is not trusted: reading is linear in its length, blocks nest a limited number
of levels, and what is not CMake raises `UnreadableError`, which callers turn into a note.
Source: the syntax chapter of the CMake manual, cmake-language(7).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Iterator

MAX_BYTES = 1 << 18  # five times the longest one seen in thirty public repositories
_MAX_DEPTH = 20

_BLANK = re.compile(r"[ \t\r\f\v\n]+")
_NAME = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)[ \t]*\(")
_BRACKET = re.compile(r"\[(=*)\[")
# Loops are unrolled so that matching needs no stack for a long text.
_QUOTED = re.compile(r'"([^"\\]*(?:\\.[^"\\]*)*)"', re.DOTALL)
_WORD = re.compile(r'(?:[^\s()#"\\]|\\.)[^\s()#"\\]*(?:\\.[^\s()#"\\]*)*', re.DOTALL)
_CLOSERS = {"if": "endif", "foreach": "endforeach", "while": "endwhile", "function": "endfunction"}
_CLOSERS |= {"macro": "endmacro", "block": "endblock"}
_MIDDLE = ("elseif", "else")


class UnreadableError(Exception):
    """What a CMake file does cannot be known from its text; users see it as a note.

    Attributes:
        offset: where in the text; None when the file as a whole is meant.
        path: the file, relative to the package folder, and `text` what is in it; set by who reads files.
    """

    def __init__(self, reason: str, offset: int | None = None) -> None:
        self.reason = reason
        self.offset = offset
        self.path = ""
        self.text = ""
        super().__init__(reason)


@dataclass(frozen=True, slots=True)
class Argument:
    """One argument as written; `offset` is the position of its first character in the text."""

    text: str
    kind: Literal["word", "quoted", "bracket", "parenthesis"]
    offset: int


@dataclass(frozen=True, slots=True)
class Command:
    """A command, its name in lower case."""

    name: str
    arguments: tuple[Argument, ...]
    offset: int


@dataclass(frozen=True, slots=True)
class Block:
    """A command that opens a block, and what is inside.

    Attributes:
        head: ``if(...)``, ``foreach(...)`` and the like.
        parts: for an if: each head (if, elseif, else) with its body; for others one part.
    """

    head: Command
    parts: list[tuple[Command, list[Command | Block]]] = field(default_factory=list)

    @property
    def body(self) -> list[Command | Block]:
        return self.parts[0][1]


Node = Command | Block


def parse_cmake(text: str) -> list[Node]:
    """The commands of a file.

    Raises:
        UnreadableError: the text is not CMake, or nests too deeply.
    """
    top: list[Node] = []
    open_blocks: list[Block] = []
    for command in _commands(text):
        here = open_blocks[-1].parts[-1][1] if open_blocks else top
        if command.name in _CLOSERS:
            if len(open_blocks) == _MAX_DEPTH:
                raise UnreadableError(f"blocks are nested deeper than {_MAX_DEPTH} levels", command.offset)
            block = Block(command, [(command, [])])
            here.append(block)
            open_blocks.append(block)
        elif command.name in _MIDDLE:
            if not open_blocks or open_blocks[-1].head.name != "if":
                raise UnreadableError(f"{command.name}() stands outside of an if()", command.offset)
            open_blocks[-1].parts.append((command, []))
        elif command.name in _CLOSERS.values():
            if not open_blocks or _CLOSERS[open_blocks[-1].head.name] != command.name:
                raise UnreadableError(f"{command.name}() closes nothing", command.offset)
            open_blocks.pop()
        else:
            here.append(command)
    if open_blocks:
        head = open_blocks[-1].head
        raise UnreadableError(f"{head.name}() has no {_CLOSERS[head.name]}()", head.offset)
    return top


def every_command(nodes: list[Node]) -> Iterator[Command]:
    """All commands, those inside blocks and the heads of blocks included."""
    waiting: list[Node] = list(nodes)
    while waiting:
        node = waiting.pop()
        if isinstance(node, Command):
            yield node
            continue
        for head, body in node.parts:
            yield head
            waiting += body


def _commands(text: str) -> Iterator[Command]:
    position = _skip(text, 0)
    while position < len(text):
        name = _NAME.match(text, position)
        if name is None:
            raise UnreadableError("expected a command", position)
        arguments, after = _arguments(text, name.end())
        yield Command(name[1].lower(), tuple(arguments), position)
        position = _skip(text, after)


def _arguments(text: str, position: int) -> tuple[list[Argument], int]:
    """The arguments up to the closing parenthesis, and the position behind it."""
    found: list[Argument] = []
    start, depth = position, 0
    while True:
        position = _skip(text, position)
        if position == len(text):
            raise UnreadableError("a parenthesis is not closed", start)
        char = text[position]
        if char == ")" and depth == 0:
            return found, position + 1
        if char in "()":
            depth += 1 if char == "(" else -1
            found.append(Argument(char, "parenthesis", position))
            position += 1
            continue
        argument, position = _argument(text, position)
        found.append(argument)


def _argument(text: str, position: int) -> tuple[Argument, int]:
    if bracket := _BRACKET.match(text, position):
        inside, after = _bracketed(text, bracket)
        return Argument(inside, "bracket", position), after
    quoted = text[position] == '"'
    found = (_QUOTED if quoted else _WORD).match(text, position)
    if found is None:
        raise UnreadableError("a quotation mark is not closed" if quoted else "expected an argument", position)
    return Argument(found[1] if quoted else found[0], "quoted" if quoted else "word", position), found.end()


def _bracketed(text: str, opening: re.Match[str]) -> tuple[str, int]:
    closing = f"]{opening[1]}]"
    end = text.find(closing, opening.end())
    if end < 0:
        raise UnreadableError(f"{opening[0]} is not closed", opening.start())
    return text[opening.end() : end], end + len(closing)


def _skip(text: str, position: int) -> int:
    """The position behind blanks and comments."""
    while position < len(text):
        if blank := _BLANK.match(text, position):
            position = blank.end()
        elif text[position] == "#":
            if bracket := _BRACKET.match(text, position + 1):
                position = _bracketed(text, bracket)[1]
            else:
                end = text.find("\n", position)
                position = len(text) if end < 0 else end
        else:
            break
    return position
