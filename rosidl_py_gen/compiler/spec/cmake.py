"""Reads a package's CMakeLists.txt for what its `rosidl_generate_interfaces` calls list, straight through.

Nothing is run, and no condition is decided: what `set`, `list` and `file(GLOB)` put into variables counts in the order
it stands there, and inside of blocks it is added, so that whatever may be built is taken in. What other commands make
of a variable is unknown. Only names in the package folder are looked at.
"""

from __future__ import annotations

import fnmatch
import os
import posixpath
import re
from dataclasses import dataclass
from itertools import takewhile
from typing import TYPE_CHECKING, TypeAlias

from rosidl_py_gen.base.names import KINDS
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

GENERATE = "rosidl_generate_interfaces"
ROOT = "/\1"
"""The package folder in values, so that no path of this machine gets into them."""
UNKNOWN = "\0"
"""Stands in a value for what cannot be known."""
Values: TypeAlias = "dict[str, bool]"
"""The elements of a list, and whether every build has them."""

_TOKEN = re.compile(
    r'#\[(=*)\[|#[^\n]*|\[(=*)\[|"([^"\\]*(?:\\.[^"\\]*)*)"|[()]|(?:[^\s()#"\\]+|\\.)+|\s+|.', re.DOTALL
)
_NAME = re.compile(r"[\w./+-]+")
_ALONE = re.compile(r"\$\{([\w./+-]+)\}")
_BLOCKS = ("if", "foreach", "while", "function", "macro", "block")
_HARMLESS = ("message", "install", "find_package", "return", "if", "elseif", "else", "endif", "endforeach", GENERATE)
_HARMLESS_PREFIXES = ("target_", "add_", "ament_", "link_", "rosidl_", "rclcpp_", "catkin_", "include_", "set_")
_FOLDERS = "CMAKE_SOURCE_DIR", "PROJECT_SOURCE_DIR", "CMAKE_CURRENT_SOURCE_DIR", "CMAKE_CURRENT_LIST_DIR"
MAX_BYTES = 1 << 20
_MAX_LENGTH = 4096
_MAX_DEPTH = 12
_MAX_STARS = 4
_LOOK = 500
"""What one look at a folder or a listed file counts in characters: it is a call of the system or several."""
_MAX_WORK = 2_000_000
"""Characters of values and names of files that one CMakeLists.txt may make this look at."""


class UnreadableError(RosidlError):
    """What a CMakeLists.txt lists cannot be known."""

    def __init__(self, reason: str, offset: int | None = None) -> None:
        super().__init__(reason)
        self.reason, self.offset = reason, offset


@dataclass(frozen=True, slots=True)
class Word:
    """One argument as it stands in the file."""

    text: str
    offset: int
    is_plain: bool = True
    is_raw: bool = False


@dataclass(frozen=True, slots=True)
class Call:
    """One call: where, whether it is outside of all blocks, and what each argument brings (behind the target name)."""

    offset: int
    certain: bool
    arguments: tuple[tuple[Word, Values], ...]


def commands(text: str) -> Iterator[tuple[str, int, list[Word]]]:
    """Name, place and arguments of each command. Raises `UnreadableError` when this is no CMake."""
    name, begin, depth, at = "", 0, 0, 0
    words: list[Word] = []
    while found := _TOKEN.match(text, at):
        token, start, at = found[0], at, found.end()
        if found[1] is not None or found[2] is not None:  # a bracket, of a comment or an argument
            level = found[1] if found[2] is None else found[2]
            end = text.find(f"]{level}]", at)
            if end < 0:
                raise UnreadableError("a bracket is not closed", start)
            if found[2] is not None:
                words.append(Word(text[at:end], start, is_plain=False, is_raw=True))
            at = end + 2 + len(level)
        elif token == "(":
            begin, words, depth = (begin, words, depth + 1) if depth else (begin, [], 1)
        elif token == ")":
            depth -= 1
            if not depth:
                yield name, begin, words
            elif depth < 0:
                raise UnreadableError("a parenthesis is closed that was not opened", start)
        elif token == '"':
            raise UnreadableError("a quotation mark is not closed", start)
        elif found[3] is not None:
            words.append(Word(found[3], start, is_plain=False))
        elif depth and not token.isspace() and token[0] != "#":
            words.append(Word(token, start))
        elif not token.isspace() and token[0] != "#":
            name, begin = token.lower(), start
    if depth:
        raise UnreadableError("a call is not closed", begin)


class Script:
    """One CMakeLists.txt, read.

    Attributes:
        calls: in the order they stand there.
        installs: calls of ``install(PROGRAMS ...)``, with all their arguments.
    """

    def __init__(self, folder: Path, text: str) -> None:
        """Raises `UnreadableError`: no CMake, or it lists more than a package can have."""
        self._folder = folder
        self._left = _MAX_WORK
        self._level = 0
        self._may_change = False
        """Whether there may be more files when a pattern is looked at than there are now."""
        self._may_set_any = False
        """Whether a variable was set whose name cannot be known."""
        self._functions: set[str] = set()
        self._values: dict[str, Values | None] = {name: {ROOT: True} for name in _FOLDERS}
        everything = list(commands(text))
        self._own = {words[index].text for name, _, words in everything for index in _sets(name, words)}
        self.calls: list[Call] = []
        self.installs: list[Call] = []
        for name, offset, words in everything:
            self._level = max(0, self._level + (name in _BLOCKS) - (name[:3] == "end" and name[3:] in _BLOCKS))
            self._read(name, offset, words)

    def _read(self, name: str, offset: int, words: list[Word]) -> None:
        first = words[0].text if words else ""
        if name == GENERATE or (name == "install" and first == "PROGRAMS"):
            arguments = tuple((word, dict(self._expanded(word))) for word in words[name == GENERATE :])
            self._spend(_LOOK // 5 * sum(len(values) for _, values in arguments))
            calls = self.calls if name == GENERATE else self.installs
            calls.append(Call(offset, self._level == 0, arguments))
        elif name == "project":
            self._values.update({"PROJECT_NAME": {first: True}, f"{first}_SOURCE_DIR": {ROOT: True}})
        elif name == "set" and self._level == 0 and words[-1:] and words[-1].text == "PARENT_SCOPE":
            pass  # there is no scope around this one
        elif name == "set":
            self._set(words[:1], self._all(takewhile(_is_value, words[1:])))
        elif name == "unset":
            self._set(words[:1], {})
        elif name == "list" and len(words) > 1 and first.upper() in ("APPEND", "PREPEND", "INSERT"):
            self._add(words[1], self._all(words[3 if first.upper() == "INSERT" else 2 :]))
        elif name == "list" and first.upper() in ("SORT", "REVERSE", "REMOVE_DUPLICATES"):
            pass  # the order does not matter
        elif name == "file" and len(words) > 1 and first.upper() in ("GLOB", "GLOB_RECURSE"):
            self._set(words[1:2], self._globbed(words[2:], is_deep=first.upper() == "GLOB_RECURSE"))
        elif name == "file" and first.upper() in ("COPY", "DOWNLOAD", "WRITE", "GENERATE"):
            self._may_change = True
        elif name in ("include", "add_subdirectory"):
            self._include(words[:1], "CMakeLists.txt" if name == "add_subdirectory" else "")
        elif name in self._functions or (name not in _HARMLESS and not name.startswith(_HARMLESS_PREFIXES)):
            if name in ("function", "macro"):
                self._functions.add(first.lower())
            for word in words[:1] if name == "foreach" else words:
                named = self._expanded(word) if word.is_plain else ()
                self._values.update(dict.fromkeys(self._own.intersection(named)))

    # ------------------------------------------------------------------------------------------------------ variables

    def _set(self, target: Sequence[Word], values: Values) -> None:
        """Outside of blocks the values are these; inside, the old ones may stay."""
        name = self._name(target)
        before = self._value(name) if self._level and name in self._values else {}
        self._spend(len(before))
        kept = {text: sure and text in values for text, sure in before.items()}
        self._values[name] = kept | self._here(values) | kept

    def _add(self, target: Word, values: Values) -> None:
        before = self._values.setdefault(self._name([target]), {})
        if before is not None:
            for text, sure in self._here(values).items():
                before.setdefault(text, sure)

    def _name(self, target: Sequence[Word]) -> str:
        """The variable that a command sets. When that cannot be known, it may be any from here on."""
        names = list(self._all(target))
        if len(names) == 1 and UNKNOWN not in names[0]:
            return names[0]
        self._may_set_any = self._may_set_any or bool(target)
        return ""

    def _include(self, target: Sequence[Word], file: str) -> None:
        """Variables that another file of the package names may have more elements behind it."""
        names = list(self._all(target))
        whole = inside(posixpath.join(names[0], file)) if len(names) == 1 else None
        if whole is None:  # of CMake, or of another package
            return
        self._spend(_LOOK)
        try:
            text = read_text(self._folder, whole[len(ROOT) + 1 :])
        except UnreadableError:
            return
        self._spend(len(text))
        for name in self._own.intersection(_NAME.findall(text)):
            before = self._values.get(name, {})
            self._values[name] = None if before is None else before | {UNKNOWN: False}

    def _here(self, values: Values) -> Values:
        return values if self._level == 0 else dict.fromkeys(values, False)

    def _all(self, words: Sequence[Word] | Iterator[Word]) -> Values:
        found: Values = {}
        for word in words:
            found |= self._expanded(word)
        return found

    def _expanded(self, word: Word) -> Values:
        """The elements that a word stands for."""
        alone = None if word.is_raw else _ALONE.fullmatch(word.text)
        if alone is not None:
            found = self._value(alone[1])
        else:
            text, sure = (word.text, True) if word.is_raw else self._replaced(word.text)
            found = {part: sure for part in text.split(";") if part}
        self._spend(sum(map(len, found)) + len(word.text))
        return found

    def _value(self, name: str) -> Values:
        """What a variable holds: nothing before the file sets it, unknown when it never does."""
        found = self._values.get(name, {} if name in self._own else None)
        if found is None:
            return {UNKNOWN: True}
        return found | {UNKNOWN: False} if self._may_set_any and name in self._own else found

    def _replaced(self, text: str) -> tuple[str, bool]:
        """A text with the variables in it that have one value, and whether every build has that."""
        sure = True

        def value(reference: re.Match[str]) -> str:
            nonlocal sure
            found = self._value(reference[1])
            if len(found) != 1:
                return "" if not found else UNKNOWN
            ((one, certain),) = found.items()
            sure = sure and certain
            self._spend(len(one))
            return one

        text = _ALONE.sub(value, text)
        if len(text) > _MAX_LENGTH or UNKNOWN in text or re.search(r"\$(ENV|CACHE)?[{<]", text):
            return UNKNOWN, sure
        return re.sub(r"\\(\n|(.))", r"\2", text, flags=re.DOTALL), sure

    def _spend(self, work: int) -> None:
        self._left -= work + 1
        if self._left < 0:
            raise UnreadableError("it lists more than a package can have")

    # ---------------------------------------------------------------------------------------------------------- files

    def _globbed(self, words: list[Word], *, is_deep: bool) -> Values:
        base, patterns, waiting = "", list[str](), iter(words)
        for word in waiting:
            if word.text in ("RELATIVE", "LIST_DIRECTORIES"):
                value = next(iter(self._expanded(next(waiting, word))), UNKNOWN)
                base = value if word.text == "RELATIVE" else base
            elif word.text not in ("CONFIGURE_DEPENDS", "FOLLOW_SYMLINKS"):
                patterns += self._expanded(word)
        start = inside(base) if base else ""
        found: Values = {UNKNOWN: True} if start is None or self._may_change else {}
        for pattern in patterns:
            whole = inside(pattern)
            if whole is None or any(part.count("*") > _MAX_STARS for part in whole.split("/")):
                return {UNKNOWN: True}
            paths = [f"{ROOT}/{path}" for path in self._matching(whole[len(ROOT) + 1 :].split("/"), is_deep)]
            found |= {posixpath.relpath(path, start) if start else path: True for path in paths}
        return found

    def _matching(self, parts: list[str], is_deep: bool) -> list[str]:
        """Files below the package folder that a pattern matches, hidden ones not."""
        plain = list(takewhile(lambda part: not any(char in part for char in "*?["), parts[:-1]))
        *holders, last = (re.compile(fnmatch.translate(part)).match for part in parts[len(plain) :])
        depth = _MAX_DEPTH if is_deep else len(holders)
        waiting, found = [("/".join(plain), 0)], []
        while waiting:
            place, level = waiting.pop()
            for name, is_folder in self._names(place):
                path = f"{place}/{name}" if place else name
                if is_folder and level < depth and (level >= len(holders) or holders[level](name)):
                    waiting.append((path, level + 1))
                elif not is_folder and level >= len(holders) and last(name):
                    found.append(path)
        return sorted(found)

    def _names(self, place: str) -> list[tuple[str, bool]]:
        """What is in a folder, and which are folders; nothing when it cannot be read or lies elsewhere."""
        self._spend(_LOOK)
        try:
            real = os.path.realpath(self._folder / place)
            if place not in KINDS and os.path.commonpath([real, home := os.path.realpath(self._folder)]) != home:
                return []
            with os.scandir(real) as entries:
                found = [(one.name, one.is_dir(follow_symlinks=False)) for one in entries if one.name[0] != "."]
        except (OSError, ValueError):
            return []
        self._spend(_LOOK // 10 * len(found))
        return found


def read_text(folder: Path, name: str) -> str:
    """What a file of the package holds. Raises `UnreadableError`."""
    try:
        real, home = os.path.realpath(folder / name), os.path.realpath(folder)
        if os.path.commonpath([real, home]) != home:
            raise UnreadableError("the file lies outside the package folder")
        if not os.path.isfile(real):  # opening a pipe would wait for who writes into it
            raise UnreadableError("there is no such file")
        with open(real, "rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise UnreadableError(f"the file cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if len(raw) > MAX_BYTES:
        raise UnreadableError(f"the file is longer than {MAX_BYTES} bytes")
    return raw.decode(errors="replace").replace("\0", "\ufffd").replace("\1", "\ufffd")


def inside(path: str) -> str | None:
    """The absolute form of a path in the package; None when it lies elsewhere or cannot be known."""
    whole = posixpath.normpath(posixpath.join(ROOT, path))
    return whole if UNKNOWN not in whole and (whole == ROOT or whole.startswith(ROOT + "/")) else None


def _is_value(word: Word) -> bool:
    return not (word.is_plain and word.text in ("CACHE", "PARENT_SCOPE"))


def _sets(name: str, words: list[Word]) -> range:
    """Which arguments name a variable that the command sets."""
    if name in ("set", "unset", "foreach", "option"):
        return range(min(1, len(words)))
    return range(1, min(2, len(words))) if name in ("list", "file") else range(0)
