"""Break lines that are too long, the way `ruff format` leaves alone.

A bracket whose content does not fit is opened up with one element a line and a trailing comma; the trailing comma is
what makes the formatter keep it. Works on single logical lines of code, never on docstrings.
"""

from __future__ import annotations

import re
from itertools import pairwise

WIDTH = 88
_OPEN = {"(": ")", "[": "]", "{": "}"}
_SIGNS = frozenset("()[]{},")
_MAX_FOLDED = 100_000
"""Length of a line that is not folded: it holds a table or a value that no reader wants on thousands of lines."""
_TOKEN = re.compile(r"""[()\[\]{},]|"[^"\\]*(?:\\.[^"\\]*)*"?|'[^'\\]*(?:\\.[^'\\]*)*'?""")
_PRAGMA = "  # type: ignore[assignment]"


class Folder:
    """Folds the code of one module.

    Attributes:
        overflow: a line could not be broken in a way a formatter agrees with (names of absurd length); the module then
            asks formatters to leave it alone.
    """

    def __init__(self) -> None:
        self.overflow = False

    def code(self, text: str, indent: int = 0) -> str:
        """Indent every line of `text` by `indent` blanks and break those longer than WIDTH."""
        lines: list[str] = []
        for line in text.splitlines():
            if line.strip():
                lines += self.line(" " * indent + line)
            else:
                lines.append("")
        return "\n".join(lines)

    def parameter(self, text: str, indent: int) -> str:
        """One parameter of a function that has each on a line of its own; formatters differ in how they break it."""
        line = f"{' ' * indent}{text},"
        self.overflow |= len(line) > WIDTH
        return line

    def line(self, line: str) -> list[str]:
        """One logical line as one or more physical ones; a pragma behind it counts for no width and is kept with its
        beginning, where type checkers look for it.
        """
        pragma = _PRAGMA if line.endswith(_PRAGMA) else ""  # a string literal ends in a quote, so this is a comment
        folded = self._fold(line.removesuffix(_PRAGMA))
        return [folded[0] + pragma, *folded[1:]]

    def _fold(self, line: str) -> list[str]:
        if len(line) <= WIDTH:
            return [line]
        if len(line) > _MAX_FOLDED:
            self.overflow = True
            return [line]
        head, imported, names = line.partition(" import ")
        if imported and head.lstrip().startswith("from "):
            line = f"{head} import ({names})"
        if not line.lstrip().startswith("def "):
            plain = _wrap_plain_value(line)
            if plain:
                self.overflow |= len(plain) == 1
                return plain
            line = _parenthesise(line)
        text = line.lstrip()
        place = None if text.startswith("if ") else _bracket(line)
        items = _split(line[place[0] + 1 : place[1]]) if place else []
        if place is None or not items or (text.startswith("for ") and not text.startswith("for (")):
            self.overflow = True
            return [line]
        start, end = place
        pad = " " * (len(line) - len(line.lstrip()))
        result = [line[: start + 1]]
        comma = "" if len(items) == 1 and _is_not_a_list(line, start, end) else ","
        for item in items:
            result += self.line(f"{pad}    {item}{comma}")
        # What follows the bracket belongs to the closing line and may need breaking in turn.
        return result + self.line(pad + line[end:])


def _wrap_plain_value(line: str) -> list[str]:
    """``name = value`` whose value has no bracket to open: in parentheses if they help, else as it is."""
    target, equals, value = line.partition(" = ")
    if not equals or _bracket(value) is not None or len(_split(target.strip())) > 1:
        return []
    pad = " " * (len(line) - len(line.lstrip()))
    if len(pad) + 4 + len(value) > WIDTH:
        return [line]
    return [f"{target} = (", f"{pad}    {value}", f"{pad})"]


def _parenthesise(line: str) -> str:
    """Put parentheses around a list of assignment or loop targets, so that it can be opened up."""
    pad = " " * (len(line) - len(line.lstrip()))
    text = line.lstrip()
    before, separator, after = text.partition(" in ") if text.startswith("for ") else text.partition(" = ")
    word = "for " if text.startswith("for ") else ""
    targets = before.removeprefix(word)
    if not separator or targets.startswith("(") or len(_split(targets)) < 2:
        return line
    return f"{pad}{word}({targets}){separator}{after}"


def _bracket(line: str) -> tuple[int, int] | None:
    """The bracket to open: a list of targets first, else the last one with content at the outermost level."""
    found: list[tuple[int, int]] = []
    stack: list[int] = []
    for index, char in _code(line):
        if char in _OPEN:
            stack.append(index)
        elif char in _OPEN.values() and stack:
            start = stack.pop()
            if not stack and index > start + 1:
                found.append((start, index))
    if not found:
        return None
    first = found[0]
    if line[: first[0]].strip() in ("", "for"):  # a target list in parentheses
        return first
    return found[-1]


def _is_not_a_list(line: str, start: int, end: int) -> bool:
    """Whether the bracket holds one expression that a comma would turn into a tuple: an index, slice or parentheses."""
    if line[end - 1] == "," or line[:start].endswith(" import "):
        return False
    before = line[start - 1 : start]
    follows_name = before.isalnum() or before in ("_", "]", ")")
    return follows_name if line[start] == "[" else line[start] == "(" and not follows_name


def _code(line: str) -> list[tuple[int, str]]:
    """The brackets and commas of a line, those in string literals left out."""
    return [(found.start(), found[0]) for found in _TOKEN.finditer(line) if found[0] in _SIGNS]


def _split(content: str) -> list[str]:
    """The elements between top-level commas."""
    depth = 0
    cuts = [-1]
    for index, char in _code(content):
        if char in _OPEN:
            depth += 1
        elif char in _OPEN.values():
            depth -= 1
        elif char == "," and depth == 0:
            cuts.append(index)
    cuts.append(len(content))
    parts = [content[left + 1 : right].strip() for left, right in pairwise(cuts)]
    return [part for part in parts if part]
