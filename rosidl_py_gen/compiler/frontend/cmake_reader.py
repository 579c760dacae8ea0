"""Reader of CMakeLists.txt, which determines the arguments of commands as far as this is possible without a build.

No command is run. Variables are followed through `set`, `unset`, `list`, `file(GLOB)`, `if` and `foreach`. The
condition of an `if()` is True, False, or None if only the build can decide. If a condition depends on the build, each
branch is read. A variable whose value depends on the branch then has the elements of all branches, and none of them is
certain. A variable that any other command, function or file may change is unknown after that.

Facts: docs/internals/protocol.md 14.2.
"""

from __future__ import annotations

import operator
import posixpath
import re
import sys
from collections import ChainMap
from collections.abc import Callable
from contextlib import suppress
from fnmatch import fnmatchcase
from itertools import pairwise, takewhile, zip_longest
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.compiler.frontend.package_files import PackageBudget, PackageFiles, UnreadableError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

_MAX_WORDS = 200
"""Maximum words of a CMake condition that is evaluated; a longer condition counts as undecided, which also bounds
nested parentheses."""
_TRUE = re.compile(r"1|on|yes|true|y", re.IGNORECASE)
_FALSE = re.compile(r"|0|off|no|false|n|ignore|notfound|.*-notfound", re.IGNORECASE | re.DOTALL)
_NUMBER = re.compile(r"[+-]?\d{1,15}(\.\d{1,15})?")
_VERSION = re.compile(r"\d{1,9}(\.\d{1,9})*")
_PLAIN_REGEX = re.compile(r"\^?[\w ,:;=@!~/-]*\$?")
"""Pattern of regular expressions that CMake and Python interpret equally, and that take linear time."""
_UNARY = ("EXISTS", "COMMAND", "POLICY", "TARGET", "TEST", "IS_DIRECTORY", "IS_SYMLINK", "IS_ABSOLUTE", "IS_READABLE")
_COMPARISONS: dict[str, Callable[[int], bool]] = {
    "LESS": lambda order: order < 0,
    "LESS_EQUAL": lambda order: order <= 0,
    "EQUAL": lambda order: order == 0,
    "GREATER_EQUAL": lambda order: order >= 0,
    "GREATER": lambda order: order > 0,
}
_BINARY = re.compile(f"(STR|VERSION_)?({'|'.join(_COMPARISONS)})|MATCHES|IN_LIST|PATH_EQUAL|IS_NEWER_THAN")


class ConditionWord(NamedTuple):
    """Word of a CMake condition with its variable references replaced.

    `text` is None if a reference has no known value.
    """

    text: str | None
    is_quoted: bool = False


Lookup = Callable[[str], str | None]
"""Function that returns the value of a variable; None if the value is not known, or nothing sets the variable."""
_Item = ConditionWord | bool | None


def evaluate_condition(words: list[ConditionWord], lookup: Lookup) -> bool | None:
    """Return the value of a CMake condition; None if only the build can decide it."""
    if len(words) > _MAX_WORDS:
        return None
    # Innermost parentheses first; each group becomes its value.
    groups: list[list[_Item]] = [[]]
    for word in words:
        if word == ("(", False):
            groups.append([])
        elif word == (")", False):
            if len(groups) < 2:
                return None
            value = _evaluate_flat(groups.pop(), lookup)
            groups[-1].append(value)
        else:
            groups[-1].append(word)
    return _evaluate_flat(groups[0], lookup) if len(groups) == 1 else None


def _evaluate_flat(items: list[_Item], lookup: Lookup) -> bool | None:
    """Return the value of a CMake condition without parentheses: tests first, then NOT, then AND and OR.

    Returns None if undecided.
    """
    values: list[bool | str | None] = []  # values with the words NOT, AND and OR between them
    at = 0
    while at < len(items):
        item, following = items[at], items[at + 1 : at + 3]
        if not isinstance(item, ConditionWord):
            values.append(item)
        elif (name := _keyword(item)) in ("NOT", "AND", "OR"):
            values.append(name)
        elif name in (*_UNARY, "DEFINED") and following:
            values.append(_is_defined(following[0], lookup) if name == "DEFINED" else None)
            at += 1
        elif len(following) == 2 and _BINARY.fullmatch(_keyword(following[0])):
            values.append(_compare(item, _keyword(following[0]), following[1], lookup))
            at += 2
        else:
            values.append(_truth(item, lookup))
        at += 1
    return _combine(values)


def _keyword(item: _Item) -> str:
    return item.text or "" if isinstance(item, ConditionWord) and not item.is_quoted else ""


def _combine(values: list[bool | str | None]) -> bool | None:
    # Words that do not alternate are an error in CMake.
    operands: list[bool | None] = []
    joins: list[str] = []
    is_negated, is_operand_next = False, True
    for value in values:
        if value == "NOT" and is_operand_next:
            is_negated = not is_negated
        elif isinstance(value, str):
            if is_operand_next:
                return None
            joins.append(value)
            is_operand_next = True
        elif not is_operand_next:
            return None
        else:
            operands.append(value != is_negated if value is not None else None)
            is_negated, is_operand_next = False, False
    if is_operand_next:
        return None
    if set(joins) == {"AND", "OR"}:
        return None  # which comes first depends on the release
    if "OR" in joins:
        return True if True in operands else None if None in operands else False
    return False if False in operands else None if None in operands else True


def _is_defined(item: _Item, lookup: Lookup) -> bool | None:
    # An empty value is left undecided: `set(x "")` defines a variable, `set(x)` does not.
    return True if isinstance(item, ConditionWord) and item.text is not None and lookup(item.text) else None


def _truth(word: ConditionWord, lookup: Lookup) -> bool | None:
    """Return the truth value of a single word of a CMake condition, which is a constant or the name of a variable.

    Returns None if only the build can decide it.
    """
    if word.text is None:
        return None
    if _TRUE.fullmatch(word.text):
        return True
    if _FALSE.fullmatch(word.text):
        return False
    if _NUMBER.fullmatch(word.text):
        return None if word.is_quoted else float(word.text) != 0
    if word.is_quoted:
        return None  # policy CMP0054
    value = lookup(word.text)
    return None if value is None else _FALSE.fullmatch(value) is None


def _operand(item: _Item, lookup: Lookup) -> str | None:
    """Return an operand of a CMake comparison: the value of the variable with this name, else the word itself.

    Returns None if only the build decides between the two.
    """
    if not isinstance(item, ConditionWord) or item.text is None:
        return None
    value = lookup(item.text)
    if value is not None:
        # A quoted name of a variable is its value before policy CMP0054.
        return value if not item.is_quoted or value == item.text else None
    is_name = re.match(r"[A-Za-z_]", item.text) is not None
    return None if is_name and not item.is_quoted else item.text


def _compare(left: _Item, name: str, right: _Item, lookup: Lookup) -> bool | None:
    first = _operand(left, lookup)
    is_pattern = name == "MATCHES" and isinstance(right, ConditionWord)
    second = right.text if is_pattern and isinstance(right, ConditionWord) else _operand(right, lookup)
    if first is None or second is None or "." in (first[:1], second[:1]):  # a path begins with "." here
        return None
    if name == "MATCHES":
        return re.search(second, first) is not None if _PLAIN_REGEX.fullmatch(second) and first.isascii() else None
    if name.startswith("STR"):
        order = (first > second) - (first < second) if (first + second).isascii() else None
        return None if order is None else _COMPARISONS[name[3:]](order)
    if name.startswith("VERSION_"):
        if not (_VERSION.fullmatch(first) and _VERSION.fullmatch(second)):
            return None
        pairs = zip_longest(first.split("."), second.split("."), fillvalue="0")
        order = next((operator.sub(int(one), int(two)) for one, two in pairs if int(one) != int(two)), 0)
        return _COMPARISONS[name[8:]](order)
    if name in _COMPARISONS:
        if not (_NUMBER.fullmatch(first) and _NUMBER.fullmatch(second)):
            return None
        difference = float(first) - float(second)
        return _COMPARISONS[name]((difference > 0) - (difference < 0))
    return None  # needs the file system or a policy


GENERATE = "rosidl_generate_interfaces"

_TOKEN = re.compile(
    r'#?\[(?P<level>=*)\[(?P<raw>.*?)(?:\](?P=level)\]|\Z)|#[^\n]*|"(?P<quoted>[^"\\]*(?:\\.[^"\\]*)*)("|\Z)|[()]'
    r'|(?:[^\s()#"\\]+|\\.)+|\s+|.',
    re.DOTALL,
)
_REFERENCE = re.compile(r"\$(?:(?=ENV\{)|\{)(ENV\{[\w./+-]+|[\w./+-]+)\}")
_UNREADABLE = re.compile(r"\\[;ntr]|\$\w*[{<]")
_BLOCKS = ("if", "foreach", "while", "function", "macro", "block")
_MAX_DEPTH = 60
"""Maximum depth of nested blocks, which bounds the recursion of the reader."""
_HARMLESS = re.compile(  # prefixes of commands that change no list
    "message|find_package|return|if|else|end|target_|ament_|link_|rosidl_|rclcpp_|catkin_|include_|set_[pt]"
    "|add_(lib|exec|comp|def|dep|custom|test|link)|cmake_(min|pol)"
)
_RECORDED = re.compile(
    f"{GENERATE}|install|(ament_auto_)?add_(executable|library)|add_launch_test|ament_add_pytest_test|ament_auto_package"
    "|ament_index_register_resource|ament_python_install_(module|package)|pluginlib_export_plugin_description_file"
)
_INSTALL_FOLDERS = {
    "CMAKE_INSTALL_PREFIX": ".",
    "CMAKE_INSTALL_BINDIR": "bin",
    "CMAKE_INSTALL_LIBDIR": "lib",
    "CMAKE_INSTALL_DATADIR": "share",
    "CMAKE_INSTALL_DATAROOTDIR": "share",
    "PYTHON_INSTALL_DIR": f"lib/python{sys.version_info[0]}.{sys.version_info[1]}/site-packages",
}
"""Variables of CMake, GNUInstallDirs and ament_cmake_python that name a folder of the installation, each with that
folder."""
_FOLDERS = "CMAKE_SOURCE_DIR", "PROJECT_SOURCE_DIR", "CMAKE_CURRENT_SOURCE_DIR", "CMAKE_CURRENT_LIST_DIR"
_PREDEFINED = {**_INSTALL_FOLDERS, **dict.fromkeys(_FOLDERS, "."), "ENV{ROS_VERSION": "2"}
_NOT_CHANGED_ELSEWHERE = {*_PREDEFINED, "PROJECT_NAME"}
"""Variables that functions and other files are assumed not to change, so their values stay known to the CMake reader.
"""
_DEFINITION = re.compile(r"\b(?:function|macro)\s*\(\s*([\w-]+)", re.IGNORECASE)
_WORD = re.compile(r'[^\s()"#;]+')
_GLOB_OPTIONS = {"RELATIVE": 2, "LIST_DIRECTORIES": 2, "CONFIGURE_DEPENDS": 1, "FOLLOW_SYMLINKS": 1}
"""Options of CMake's `file(GLOB)`, each with the number of words that it takes."""
_MAX_STARS = 4
_INCLUDES_FILE = re.compile(r"\binclude\s*\([^()]*[./$]", re.IGNORECASE)


class CMakeArgument(NamedTuple):
    """Argument of a CMake command, or element of a CMake list.

    Attributes:
        text: text, or `CMakeScript.UNKNOWN`.
        offset: offset in the file.
        certain: True if every build has the element there.
        quote: `"` for a quoted argument, `[` for a bracket argument, or empty.
    """

    text: str
    offset: int = 0
    certain: bool = True
    quote: str = ""


class CMakeCommand(NamedTuple):
    """Command of a CMakeLists.txt: name in lower case, arguments, start offset, end offset (exclusive).

    Parentheses that are nested inside the command's parentheses count as arguments.
    """

    name: str
    words: list[CMakeArgument]
    start: int
    end: int


_Value = list[CMakeArgument] | None  # elements of a variable; None: unknown


def parse_commands(text: str) -> Iterator[CMakeCommand]:
    """Yield the commands of the text of a CMakeLists.txt in order."""
    name, start, depth, words = "", 0, 0, list[CMakeArgument]()
    for found in _TOKEN.finditer(text):
        token = found[0]
        if token == "(" and not depth:
            words, depth = [], 1
        elif token == ")" and depth == 1:
            depth = 0
            yield CMakeCommand(name, words, start, found.end())
        elif token[0] == "#" or token.isspace():
            continue
        elif depth:
            depth += (token == "(") - (token == ")")
            inner, quote = token, ""
            if found["raw"] is not None:
                inner, quote = found["raw"].removeprefix("\n"), "["
            elif found["quoted"] is not None:
                inner, quote = found["quoted"], '"'
            words.append(CMakeArgument(inner, found.start(), quote=quote))
        else:
            name, start = token.lower(), found.start()


class CMakeScript:
    """Contents of a CMakeLists.txt: the `calls` of commands that define interfaces, installed files, targets and tests.

    A call is a command name and arguments. Calls in branches that a build may skip are listed, too. The first argument
    of a `rosidl_generate_interfaces` call is the name of its target. This argument is marked as uncertain in such a
    branch, or if the name is unknown. A call of `add_subdirectory` is listed if that folder has install rules.
    """

    UNKNOWN = "\0"
    """Value of an argument of a CMake command that cannot be determined."""

    def __init__(self, folder: Path, text: str, budget: PackageBudget | None = None) -> None:
        """Read the text of a CMakeLists.txt.

        Args:
            folder: the package folder.
            budget: work limit, which may be shared with readers of other files of the package.

        Raises:
            UnreadableError: the script takes more work to read than a package can need.
        """
        self._package = PackageFiles(folder)
        self._text = text
        self._files: list[list[str]] = []
        self._budget = budget or PackageBudget()
        self._undecided = 0  # depth of blocks that a build may skip
        self._is_in_function = False
        self._is_ended = False  # the build does not come here
        self._may_be_ended = False  # a block that a build may skip ends the file
        self.creates_files = False  # the build may add files to the package folder
        # Later maps have the values before a block whose condition is undecided.
        self._values = ChainMap[str, _Value]({name: [CMakeArgument(value)] for name, value in _PREDEFINED.items()})
        self._cached: set[str] = set()  # variables that have a value in the cache of CMake, too
        self._functions: dict[str, str] = {}  # functions and macros, and the text that may change variables
        self.calls: list[tuple[str, list[CMakeArgument]]] = []
        self._commands = list(parse_commands(text))
        self._sections = _find_blocks(self._commands)
        self._run(0, len(self._commands))

    @classmethod
    def read(cls, folder: Path, budget: PackageBudget | None = None) -> CMakeScript:
        """Read the CMakeLists.txt of a package folder, with the arguments of `__init__`.

        Raises:
            UnreadableError: the file cannot be read, or takes more work than a package can need.
        """
        return cls(folder, PackageFiles(folder).read_text("CMakeLists.txt"), budget)

    # --- Blocks -------------------------------------------------------------------------------------------------------

    def _run(self, start: int, stop: int) -> None:
        while start < stop and not self._is_ended:
            command = self._commands[start]
            self._budget.step()
            marks = self._sections.get(start)
            if marks is None:
                self._read(command.name, command.words, command.words[0].text.upper() if command.words else "")
                start += 1
            else:
                self._run_block(command, marks)
                start = marks[-1] + 1

    def _run_block(self, command: CMakeCommand, marks: list[int]) -> None:
        text = self._text[command.start : self._commands[marks[-1] - 1].end]
        if command.name == "if":
            self._run_if(marks)
        elif command.name == "foreach":
            self._run_foreach(command, marks, text)
        elif command.name in ("function", "macro"):
            # Calls inside count once, with the values of now.
            before, self._is_in_function = self._is_in_function, True
            changed, _ = self._branch(marks[0] + 1, marks[-1])
            self._is_in_function = before
            if command.words:
                # The body may change what an included file or another function names.
                self._functions[self._only(command.words[0]).lower()] = " ".join((text, *changed))
        else:
            self._run_maybe(marks, text)

    def _run_if(self, marks: list[int]) -> None:
        possible: list[tuple[int, int]] = []
        is_exhaustive = False
        for mark, following in pairwise(marks):
            name, words, *_ = self._commands[mark]
            value = True if name == "else" else evaluate_condition(self._condition_words(words), self._scalar)
            if value is not False:
                possible.append((mark + 1, following))
            if value:
                is_exhaustive = True
                break
        if is_exhaustive and len(possible) == 1:
            self._run(*possible[0])
            return
        outcomes = [changed for changed, is_ended in (self._branch(*section) for section in possible) if not is_ended]
        self._is_ended = bool(possible) and is_exhaustive and not outcomes
        self._join(outcomes if is_exhaustive else [*outcomes, {}])

    def _run_foreach(self, command: CMakeCommand, marks: list[int], text: str) -> None:
        name = self._only(command.words[0]) if command.words else self.UNKNOWN
        items = self._loop_items(command.words[1:])
        jumps = {command.name for command in self._commands[marks[0] : marks[-1]]} & {"break", "continue"}
        if jumps or self.UNKNOWN in name or any(item.text == self.UNKNOWN or not item.certain for item in items):
            self._run_maybe(marks, text)
            return
        had_value = name in self._values
        before = self._values.get(name)
        for item in items:
            self._values[name] = [item] if item.text else []
            self._run(marks[0] + 1, marks[-1])
        self._values[name] = before if had_value else None

    def _loop_items(self, words: list[CMakeArgument]) -> list[CMakeArgument]:
        unknown = [CMakeArgument(self.UNKNOWN)]
        keyword = words[0].text if words and not words[0].quote else ""
        if keyword != "IN":
            return unknown if keyword == "RANGE" else [item for word in words for item in self._items(word)]
        items: list[CMakeArgument] = []
        for word in words[1:]:
            if not word.quote and word.text in ("LISTS", "ITEMS", "ZIP_LISTS"):
                keyword = word.text
            elif keyword == "LISTS":
                items += self._value(self._only(word))
            else:
                items += self._items(word) if keyword == "ITEMS" else unknown
        return items

    def _items(self, word: CMakeArgument) -> list[CMakeArgument]:
        """Return the loop items that an argument of CMake's `foreach` becomes: a list becomes its elements, a quoted
        argument one item.
        """
        items = self._expand(word)
        if word.quote and len(items) > 1:
            text = ";".join(item.text for item in items)
            is_known = all(item.certain for item in items) and self.UNKNOWN not in text
            return [CMakeArgument(text if is_known else self.UNKNOWN, word.offset)]
        return items

    def _run_maybe(self, marks: list[int], text: str) -> None:
        """Record the calls of a CMake block that may run repeatedly or never, and mark the variables that it changes as
        unknown.
        """
        self._forget(text)
        changed, _ = self._branch(marks[0] + 1, marks[-1])
        self._set_unknown(changed)

    def _branch(self, start: int, stop: int) -> tuple[dict[str, _Value], bool]:
        """Read CMake commands that a build may skip.

        Returns the variables that these commands change, and True if they end the script.
        """
        before = self._values
        self._values = before.new_child()
        self._undecided += 1
        self._run(start, stop)
        self._undecided -= 1
        changed, self._values = dict(self._values.maps[0]), before
        is_ended, self._is_ended = self._is_ended, False
        return changed, is_ended

    def _join(self, outcomes: list[dict[str, _Value]]) -> None:
        """Merge the variables that the branches of a CMake condition changed.

        Elements that depend on the branch become uncertain.
        """
        for name in dict.fromkeys(name for outcome in outcomes for name in outcome):
            is_set_before, before = name in self._values, self._values.get(name)
            values = [outcome.get(name, before) for outcome in outcomes]
            is_always_set = all(is_set_before or name in outcome for outcome in outcomes)
            known = [value for value in values if value is not None]
            self._budget.spend(sum(len(value) for value in known) + len(name))
            texts = [[(one.text, one.certain) for one in value] for value in known]
            if is_always_set and len(known) == len(values) and all(text == texts[0] for text in texts):
                self._values[name] = known[0]
                continue
            union = {one.text: one._replace(certain=False) for value in known for one in value}
            # A variable of another package may be unknown where no branch sets it.
            is_known = union and (len(known) == len(values) or not is_always_set)
            self._values[name] = list(union.values()) if is_known else None

    # --- Commands -----------------------------------------------------------------------------------------------------

    def _read(self, name: str, words: list[CMakeArgument], first: str) -> None:
        if name in self._functions:
            self._forget(self._functions[name], *(word.text for word in self._expand(*words)))
        elif _RECORDED.fullmatch(name):
            self._record(name, words)
        elif name == "return":
            self._is_ended = True
            self._may_be_ended |= self._undecided > 0
        elif name == "message":
            self._is_ended |= first == "FATAL_ERROR" and self._undecided > 0
        elif name == "project" and words:
            project = self._only(words[0])
            self._values["PROJECT_NAME"] = [words[0]._replace(text=project)]
            self._values[f"{project}_SOURCE_DIR"] = [CMakeArgument(".")]
        elif name == "find_package" and words:
            package = self._only(words[0])
            is_here = package.startswith(("ament_", "rosidl_")) or any(word.text == "REQUIRED" for word in words)
            state = "0" if package == "catkin" else "1" if is_here else self.UNKNOWN
            self._values[f"{package}_FOUND"] = [CMakeArgument(state, words[0].offset)]
        elif name in ("set", "unset") and words:
            self._set(words[0], words[1:])
        elif name == "list" and len(words) > 1:
            self._change_list(first, words)
        elif name == "file" and len(words) > 1 and first in ("GLOB", "GLOB_RECURSE"):
            self._assign(words[1], self._glob(words[2:], is_deep=first == "GLOB_RECURSE"))
        elif name in ("include", "add_subdirectory") and words:
            self._include(words[0], is_include=name == "include")
        elif not _HARMLESS.match(name):
            self.creates_files |= name in ("file", "configure_file")
            self._set_unknown(word.text for word in self._expand(*words))

    def _record(self, name: str, words: list[CMakeArgument]) -> None:
        arguments = self._expand(*words)
        if name in (GENERATE, "install"):
            self._budget.spend(100 * len(arguments))
        if name == GENERATE and words:
            targets = self._expand(words[0])
            is_certain = len(targets) == 1 and targets[0].certain and not (self._undecided or self._may_be_ended)
            arguments = [CMakeArgument(GENERATE, words[0].offset, is_certain), *self._expand(*words[1:])]
            if len(targets) != 1 or self._is_in_function:
                arguments.append(CMakeArgument(self.UNKNOWN, words[0].offset))
        self.calls.append((name, arguments))

    def _set(self, target: CMakeArgument, words: list[CMakeArgument]) -> None:
        if words and words[-1].text == "PARENT_SCOPE":
            return  # the file has no parent, and a call of a function makes its variables unknown
        values = self._expand(*takewhile(lambda word: word.text != "CACHE", words))
        name = _key(self._only(target))
        if any(word.text == "CACHE" for word in words):
            # The cache may have another value, and the variable as well.
            self._cached.add(name)
            values = [one._replace(certain=False) for one in (*(self._values.get(name) or ()), *values)]
        self._assign(target, values if values or name not in self._cached else None)

    def _change_list(self, verb: str, words: list[CMakeArgument]) -> None:
        name = self._only(words[1])
        if self.UNKNOWN in name:
            self._forget_all()
            return
        values, given = self._own(name), self._expand(*words[2:])
        if values is None:
            self._set_unknown(one.text for one in given)
            return
        if verb == "APPEND":
            values += given
            return
        self._budget.spend(len(values))
        is_exact = all(one.certain and one.text != self.UNKNOWN for one in (*values, *given))
        if verb == "PREPEND":
            values[:0] = given
        elif verb == "INSERT" and is_exact and given and given[0].text.isdecimal():
            at = int(given[0].text[:9])
            values[at:at] = given[1:]
        elif verb == "REMOVE_ITEM" and is_exact:
            removed = {one.text for one in given}
            values[:] = [one for one in values if one.text not in removed]
        elif verb == "REMOVE_DUPLICATES" and is_exact:
            values[:] = {one.text: one for one in values}.values()
        elif verb == "SORT" and is_exact and not given:
            values.sort(key=lambda one: one.text.encode(errors="replace"))
        elif verb == "REVERSE" and is_exact:
            values.reverse()
        elif verb == "TRANSFORM" and is_exact and len(given) == 2 and given[0].text in ("PREPEND", "APPEND"):
            before, after = (given[1].text, "") if given[0].text == "PREPEND" else ("", given[1].text)
            self._budget.spend(sum(len(one.text) + len(given[1].text) for one in values))
            values[:] = [one._replace(text=before + one.text + after) for one in values]
        else:
            self._set_unknown([name, *(one.text for one in given)])

    def _assign(self, target: CMakeArgument, value: _Value) -> None:
        name = _key(self._only(target))
        if self.UNKNOWN in name:
            self._forget_all()
        else:
            self._values[name] = value

    def _own(self, name: str) -> _Value:
        """Return a copy of a CMake variable's list that the caller may change.

        Returns [] for an unset variable, None for an unknown one.
        """
        own = self._values.maps[0]
        if name not in own:
            before = self._values.get(name, [])
            self._budget.spend(len(before or ()))
            own[name] = None if before is None else list(before)
        return own[name]

    def _set_unknown(self, names: Iterable[str]) -> None:
        self._values |= dict.fromkeys(_key(name) for name in names if name not in _NOT_CHANGED_ELSEWHERE)

    def _forget_all(self) -> None:
        self._budget.spend(sum(map(len, self._values.maps)))
        self._set_unknown(list(self._values))

    def _forget(self, text: str, *names: str) -> None:
        """Mark CMake variables as unknown that the commands in `text` may change when called with the arguments
        `names`.

        These are the variables named by words of the text, by the values of these words, and by words with `${...}`
        inside.
        """
        forgotten: dict[str, None] = dict.fromkeys(names)
        texts = [text]
        for changing in texts:  # grows inside the loop
            self._budget.access()
            self._budget.spend(len(changing))
            for composed in filter(lambda word: "${" in word, _WORD.findall(changing)):
                parts = _REFERENCE.split(composed)[::2]
                if parts == ["", ""]:
                    continue
                if len(parts) > 3 or any("$" in part for part in parts):
                    self._forget_all()
                    continue
                self._budget.spend(sum(map(len, self._values.maps)))
                pattern = re.compile(".*".join(map(re.escape, parts)), re.DOTALL)
                forgotten |= dict.fromkeys(name for name in self._values if pattern.fullmatch(name))
            for word in set(re.findall(r"[\w./+-]+", changing)):
                forgotten[word] = None
                value = self._values.get(word) if word not in _NOT_CHANGED_ELSEWHERE else None
                forgotten |= dict.fromkeys(one.text for one in value or ())
                called = self._functions.get(word.lower(), "")
                if called and called not in texts:
                    texts.append(called)
        self._set_unknown(forgotten)

    def _include(self, target: CMakeArgument, *, is_include: bool) -> None:
        """Mark CMake variables as unknown that an included file or a subdirectory of the package may set."""
        path = PackageFiles.inside(posixpath.join(self._only(target), "" if is_include else "CMakeLists.txt"))
        text = ""
        with suppress(UnreadableError):  # a module of CMake is not in the package
            text = self._package.read_text(path) if path else ""
        self._budget.access()
        self._budget.spend(len(text))
        if GENERATE in text.lower() and "SKIP_INSTALL" not in text:  # SKIP_INSTALL: for tests
            self.calls.append((GENERATE, [target, CMakeArgument(self.UNKNOWN, target.offset)]))
        if not is_include and "install" in text.lower():
            self.calls.append(("add_subdirectory", [target]))
        if path is None:  # a file of another package, unless this script sets the name
            if not self._values.keys().isdisjoint({*_REFERENCE.findall(target.text)} - _NOT_CHANGED_ELSEWHERE):
                self._forget_all()
        elif is_include or "PARENT_SCOPE" in text or "CACHE" in text:
            if _INCLUDES_FILE.search(text):
                self._forget_all()
            self._functions |= dict.fromkeys((name.lower() for name in _DEFINITION.findall(text)), text)
            self._forget(text)

    # --- Values -------------------------------------------------------------------------------------------------------

    def _only(self, word: CMakeArgument) -> str:
        values = self._expand(word)
        return values[0].text if len(values) == 1 and values[0].certain else self.UNKNOWN

    def _scalar(self, name: str) -> str | None:
        """Return the value of a CMake variable as one text; None if the value is uncertain or the variable
        is not set.
        """
        value = self._values.get(_key(name))
        if value is None or not all(one.certain and one.text != self.UNKNOWN for one in value):
            return None
        self._budget.spend(sum(len(one.text) for one in value))
        return ";".join(one.text for one in value)

    def _condition_words(self, words: list[CMakeArgument]) -> list[ConditionWord]:
        found: list[ConditionWord] = []
        for word in words:
            values = self._expand(word)
            texts = [one.text if one.certain and one.text != self.UNKNOWN else None for one in values]
            if word.quote:
                text = None if None in texts else ";".join(filter(None, texts))
                found.append(ConditionWord(text, is_quoted=True))
            else:
                found += map(ConditionWord, texts)
        return found

    def _expand(self, *words: CMakeArgument) -> list[CMakeArgument]:
        """Return CMake arguments with their variable references replaced.

        A list becomes its elements, also inside quotes.
        """
        found: list[CMakeArgument] = []
        for word in words:
            parts = [word.text] if word.quote == "[" else _REFERENCE.split(word.text)
            values = [self._value(name) for name in parts[1::2]]
            self._budget.spend(len(word.text) + sum(len(one.text) + 1 for value in values for one in value))
            if parts[::2] == ["", ""]:
                found += [one if one.text != self.UNKNOWN else word._replace(text=self.UNKNOWN) for one in values[0]]
                continue
            is_known = word.quote == "[" or not any(map(_UNREADABLE.search, parts[::2]))
            # One element that is not certain is a guess that callers can refuse; of several, each is as likely.
            is_known &= all(len(value) == 1 or all(one.certain for one in value) for value in values)
            is_certain = word.certain and all(one.certain for value in values for one in value)
            if word.quote != "[":
                parts[::2] = [re.sub(r"\\(\n|(.))", r"\2", part, flags=re.DOTALL) for part in parts[::2]]
            parts[1::2] = [";".join(one.text for one in value) for value in values]
            text = "".join(parts)
            texts = text.split(";") if is_known and self.UNKNOWN not in text else [self.UNKNOWN]
            found += [CMakeArgument(one, word.offset, is_certain) for one in texts if one]
        return found

    def _value(self, name: str) -> list[CMakeArgument]:
        found = self._values.get(name)
        return [CMakeArgument(self.UNKNOWN)] if found is None else found

    def _glob(self, words: list[CMakeArgument], *, is_deep: bool) -> _Value:
        """Return the files that the patterns of CMake's `file(GLOB)` match; None if they cannot be determined.

        The paths begin with the package folder, or are relative to the folder of the option RELATIVE.
        """
        if not self._files:
            self._files = [path.split("/") for path in self._budget.entries("", self._package.paths())]
        found: list[CMakeArgument] = []
        base = None
        while words and words[0].text in _GLOB_OPTIONS:
            if words[0].text == "RELATIVE" and len(words) > 1:
                base = posixpath.normpath(self._only(words[1]))
            words = words[_GLOB_OPTIONS[words[0].text] :]
        if base is not None and (self.UNKNOWN in base or base.startswith(("/", ".."))):
            return None
        for pattern in self._expand(*words):
            path = PackageFiles.inside(pattern.text)
            is_readable = path is not None and path.count("*") <= _MAX_STARS and "[^" not in path
            if path is None or self.creates_files or not is_readable or not pattern.certain:
                return None
            self._budget.access(2 * len(self._files))
            wanted = path.split("/")
            for names in self._files:
                tested = names[: len(wanted) - 1] + names[-1:] if is_deep and len(names) > len(wanted) else names
                if len(tested) == len(wanted) and all(map(fnmatchcase, tested, wanted)):
                    file = "/".join(names)
                    text = f"./{file}" if base is None else posixpath.relpath(file, base)
                    found.append(CMakeArgument(text, pattern.offset))
        return found


def _key(name: str) -> str:
    """Return the key under which the reader stores a CMake variable.

    The key of an environment variable contains an open brace, so that it differs from every other variable.
    """
    return name[:-1] if name.startswith("ENV{") else name


def _find_blocks(commands: list[CMakeCommand]) -> dict[int, list[int]]:
    """Return, for the first command of each CMake block, the indices of the commands that begin or end sections of the
    block.
    """
    found: dict[int, list[int]] = {}
    is_open: list[list[int]] = []
    for at, (name, *_) in enumerate(commands):
        if name in _BLOCKS:
            found[at] = [at]
            is_open.append(found[at])
            if len(is_open) > _MAX_DEPTH:
                raise UnreadableError(f"it has more than {_MAX_DEPTH} blocks inside one another")
        elif is_open and name in ("elseif", "else") and commands[is_open[-1][0]].name == "if":
            is_open[-1].append(at)
        elif is_open and name == f"end{commands[is_open[-1][0]].name}":
            is_open.pop().append(at)
    for marks in is_open:
        marks.append(len(commands))
    return found
