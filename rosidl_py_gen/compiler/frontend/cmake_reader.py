"""Reader of CMakeLists.txt: arguments of its calls, if they consist of literal names and globs.

No command is run, and no condition is evaluated: `set`, `list(APPEND)` and `file(GLOB)` all add to a list. A variable
that any other command or file may change is unknown from there on.
"""

from __future__ import annotations

import posixpath
import re
import sys
from contextlib import suppress
from fnmatch import fnmatchcase
from itertools import takewhile
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.compiler.frontend.package_files import UnreadableError, files_below, read_text

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

GENERATE = "rosidl_generate_interfaces"
UNKNOWN = "\0"
"""Value of an argument that cannot be determined."""

_TOKEN = re.compile(
    r'#?\[(?P<level>=*)\[(?P<raw>.*?)(?:\](?P=level)\]|\Z)|#[^\n]*|"(?P<quoted>[^"\\]*(?:\\.[^"\\]*)*)("|\Z)|[()]'
    r'|(?:[^\s()#"\\]+|\\.)+|\s+|.',
    re.DOTALL,
)
_REFERENCE = re.compile(r"\$\{([\w./+-]+)\}")
_BLOCKS = ("if", "foreach", "while", "function", "macro", "block")
_HARMLESS = re.compile(  # prefixes of commands that change no list
    "message|set |unset|find_|return|if|else|end|target_|ament_|link_|rosidl_|rclcpp_|catkin_|include_|set_[pt]"
    "|add_(lib|exec|comp|def|dep|custom|test|link)|list (sort|reverse|remove_d)"
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
"""Variables of CMake, GNUInstallDirs and ament_cmake_python with folders of a prefix; `set` may add other values."""
_FOLDERS = "CMAKE_SOURCE_DIR", "PROJECT_SOURCE_DIR", "CMAKE_CURRENT_SOURCE_DIR", "CMAKE_CURRENT_LIST_DIR"
_GLOB_WORDS = ("RELATIVE", "LIST_DIRECTORIES", "CONFIGURE_DEPENDS", "FOLLOW_SYMLINKS")
_MAX_STARS = 4
_MAX_PATH = 4096
_ACCESS_COST = 500
"""Cost of one access to a file or folder in characters: it is at least one system call."""
_MAX_BUDGET = 2_000_000
"""Maximum characters of values and file names to process for one CMakeLists.txt, so that its reader takes bounded time.
"""


class CMakeArgument(NamedTuple):
    """An argument or an element of a list, with its offset in the file; `certain`: every build has it."""

    text: str
    offset: int = 0
    certain: bool = True


def parse_commands(text: str) -> Iterator[tuple[str, list[CMakeArgument]]]:
    """Yield name and arguments of each command."""
    name, depth, words = "", 0, list[CMakeArgument]()
    for found in _TOKEN.finditer(text):
        token = found[0]
        if token == "(":
            words, depth = (words, depth + 1) if depth else ([], 1)
        elif token == ")" and depth:
            depth -= 1
            if not depth:
                yield name, words
        elif token[0] == "#" or token.isspace():
            continue
        elif depth:
            inner = found["raw"] if found["quoted"] is None else found["quoted"]
            words.append(CMakeArgument(token if inner is None else inner, found.start()))
        else:
            name = token.lower()


class CMakeScript:
    """A CMakeLists.txt with its `calls` of commands that define interfaces, installed files, targets and tests.

    A call is a name and arguments. A call of `add_subdirectory` is listed if that folder has install rules.
    """

    def __init__(self, folder: Path, text: str) -> None:
        """Read a script; raises `UnreadableError` if it lists more than a package can have."""
        self._folder = folder
        self._files: list[list[str]] = []
        self._budget = _MAX_BUDGET
        self._depth = 0  # depth of blocks
        self._is_lost = False  # any variable may have been set
        self.creates_files = False  # the build may add files to the package folder
        self._fixed = dict.fromkeys(_FOLDERS, ".")
        self._values: dict[str, dict[str, CMakeArgument] | None] = {
            name: {text: CMakeArgument(text)} for name, text in _INSTALL_FOLDERS.items()
        }
        self.calls: list[tuple[str, list[CMakeArgument]]] = []
        for name, words in parse_commands(text):
            self._depth = max(0, self._depth + (name in _BLOCKS) - (name[:3] == "end" and name[3:] in _BLOCKS))
            self._read(name, words, words[0].text.upper() if words else "")

    def _read(self, name: str, words: list[CMakeArgument], first: str) -> None:
        if _RECORDED.fullmatch(name):
            self.calls.append((name, self._expand(*words)))
        if name in (GENERATE, "install"):
            self._spend(_ACCESS_COST // 5 * len(self.calls[-1][1]))
        elif name == "project" and words:
            self._fixed |= {"PROJECT_NAME": words[0].text, f"{words[0].text}_SOURCE_DIR": "."}
        elif name == "set" and words and (words[-1].text != "PARENT_SCOPE" or self._depth):  # the file has no parent
            values = takewhile(lambda word: word.text not in ("CACHE", "PARENT_SCOPE"), words[1:])
            self._add(words[0], self._expand(*values))
        elif name == "list" and len(words) > 1 and first in ("APPEND", "PREPEND", "INSERT"):
            self._add(words[1], self._expand(*words[3 if first == "INSERT" else 2 :]))
        elif name == "file" and len(words) > 1 and first in ("GLOB", "GLOB_RECURSE"):
            self._add(words[1], self._glob(words[2:], is_deep=first == "GLOB_RECURSE"))
        elif name in ("include", "add_subdirectory") and words:
            self._include(words[0], is_include=name == "include")
        elif not _HARMLESS.match(f"{name} {first.lower()}"):
            self.creates_files |= name in ("file", "configure_file")
            self._values |= dict.fromkeys(word.text for word in self._expand(*words))

    def _add(self, target: CMakeArgument, words: list[CMakeArgument]) -> None:
        name = self._only(target)
        self._is_lost |= name == UNKNOWN
        if (values := self._values.setdefault(name, {})) is not None:
            for word in words:
                values.setdefault(word.text, word._replace(certain=word.certain and not self._depth))

    def _include(self, target: CMakeArgument, *, is_include: bool) -> None:
        """Make the variables unknown that another file of the package may set."""
        path = inside(posixpath.join(self._only(target), "" if is_include else "CMakeLists.txt"))
        text = ""
        with suppress(UnreadableError):  # a module of CMake is not in the package
            text = read_text(self._folder, path) if path else ""
        self._spend(_ACCESS_COST + len(text))
        if GENERATE in text.lower() and "SKIP_INSTALL" not in text:  # SKIP_INSTALL: for tests
            self.calls.append((GENERATE, [target, CMakeArgument(UNKNOWN, target.offset)]))
        if not is_include and "install" in text.lower():
            self.calls.append(("add_subdirectory", [target]))
        if path is None:  # a file of another package, unless this script sets the name
            self._is_lost |= not self._values.keys().isdisjoint(_REFERENCE.findall(target.text))
        elif is_include or "PARENT_SCOPE" in text or "CACHE" in text:
            self._is_lost |= re.search(r"\binclude\s*\([^)]*[./$]", text, re.IGNORECASE) is not None
            self._values |= dict.fromkeys(re.findall(r"[\w./+-]+", text))

    def _only(self, word: CMakeArgument) -> str:
        values = self._expand(word)
        return values[0].text if len(values) == 1 else UNKNOWN

    def _expand(self, *words: CMakeArgument) -> list[CMakeArgument]:
        found: list[CMakeArgument] = []
        for word in words:
            parts = _REFERENCE.split(word.text)
            values = [self._value(name) for name in parts[1::2]]
            self._spend(len(word.text) + sum(len(text) for one in values for text in one))
            if parts[::2] == ["", ""]:
                found += [part if part.text != UNKNOWN else word._replace(text=UNKNOWN) for part in values[0].values()]
            else:
                parts[1::2] = ["".join(one) if len(one) < 2 else UNKNOWN for one in values]
                text = re.sub(r"\\(\n|(.))", r"\2", "".join(parts), flags=re.DOTALL)
                is_known = UNKNOWN not in text and not re.search(r"\$\w*[{<]", text)
                found += [
                    CMakeArgument(part, word.offset) for part in (text if is_known else UNKNOWN).split(";") if part
                ]
        return found

    def _value(self, name: str) -> dict[str, CMakeArgument]:
        found = None if self._is_lost or name in self._fixed else self._values.get(name)
        text = self._fixed.get(name, UNKNOWN)
        return {text: CMakeArgument(text)} if found is None else found

    def _glob(self, words: list[CMakeArgument], *, is_deep: bool) -> list[CMakeArgument]:
        """Return the matching files by their paths below the package folder, whatever RELATIVE says."""
        self._files = self._files or [path.split("/") for path in files_below(self._folder)]
        found: list[CMakeArgument] = []
        for pattern in self._expand(*(word for word in words if word.text not in _GLOB_WORDS)):
            path = "." if pattern.text == "." else inside(pattern.text)  # it follows RELATIVE
            if path is None or self.creates_files or path.count("*") > _MAX_STARS:
                return [CMakeArgument(UNKNOWN, pattern.offset)]
            self._spend(_ACCESS_COST + _ACCESS_COST // 10 * len(self._files))
            wanted = path.split("/")
            for names in self._files:
                tested = names[: len(wanted) - 1] + names[-1:] if is_deep and len(names) > len(wanted) else names
                if len(tested) == len(wanted) and all(map(fnmatchcase, tested, wanted)):
                    found.append(CMakeArgument("/".join(names), pattern.offset))
        return found

    def _spend(self, work: int) -> None:
        self._budget -= work + 1
        if self._budget < 0:
            raise UnreadableError("it lists more than a package can have")


def inside(path: str) -> str | None:
    """Return a path relative to the package folder; None if it lies elsewhere or is unknown."""
    path = posixpath.normpath(path)
    is_outside = len(path) > _MAX_PATH or UNKNOWN in path or path.startswith(("/", "../")) or path in (".", "..")
    return None if is_outside else path
