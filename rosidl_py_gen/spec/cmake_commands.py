"""The CMake commands that make lists of files: set, unset, option, list, file, string, project, find_package.

Any other command makes the variables it names unknown, unless it is known to set none. `cmake` runs the blocks around
them.
"""

from __future__ import annotations

import os
import posixpath
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.spec.cmake_glob import glob
from rosidl_py_gen.spec.cmake_text import Argument, Command
from rosidl_py_gen.spec.cmake_values import (
    ROOT,
    UNDEFINED,
    UNKNOWN,
    UNKNOWN_VALUE,
    Meter,
    State,
    combine,
    expand,
    inside,
    items,
    matches,
)

if TYPE_CHECKING:
    from collections.abc import Callable

INTERFACE_SUFFIXES = (".msg", ".srv", ".action", ".idl")

# Commands that set no variable of the file, whatever words they are given.
_HARMLESS = ("message", "install", "export", "enable_testing", "configure_file", "include_directories", "set_property")
_HARMLESS_PREFIXES = ("target_", "add_", "ament_", "link_", "cmake_", "rosidl_", "rclcpp_", "catkin_", "set_")
# What file() does without changing files.
_READING = ("READ", "STRINGS", "RELATIVE_PATH", "REAL_PATH", "TO_CMAKE_PATH", "TO_NATIVE_PATH", "TIMESTAMP", "SIZE")
# find_package() of these: what ROS 2 has, and what only ROS 1 has.
_FOUND = ("ament_", "rosidl_", "rclcpp", "rclpy", "builtin_interfaces")
_NOT_FOUND = ("catkin", "roscpp", "rospy", "message_generation", "genmsg", "roslib", "rosbuild")


@dataclass(frozen=True, slots=True)
class Place:
    """Where in which CMake file something stands; `path` is relative to the package folder."""

    path: str
    text: str = field(repr=False)
    offset: int


class Commands:
    """Single commands of one run.

    Attributes:
        folder: of the package.
        places: for names of interface files where each was first written.
        changed: a command may have put files into the package folder, so patterns may match more than is there now.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.meter = Meter()
        self.path, self.text = "", ""
        self.places: dict[str, Place] = {}
        self.changed = False
        self._known: dict[str, Callable[[Command, State], None]] = {
            "set": self._set,
            "unset": self._unset,
            "option": self._option,
            "list": self._list,
            "file": self._file,
            "project": self._project,
            "find_package": self._find_package,
        }

    def simple(self, command: Command, state: State) -> None:
        """Run one command that is neither a block nor a call."""
        known = self._known.get(command.name)
        if known is not None:
            known(command, state)
            return
        self.changed = self.changed or command.name == "configure_file"
        if command.name not in _HARMLESS and not command.name.startswith(_HARMLESS_PREFIXES):
            self.forget(command, state)

    def forget(self, command: Command, state: State) -> None:
        """The variables a command names are unknown from here on."""
        for argument in command.arguments:
            if argument.kind == "word" and argument.text.isidentifier() and argument.text in state.own:
                state.set(argument.text, UNKNOWN_VALUE)

    def place(self, at: Argument | Command) -> Place:
        return Place(self.path, self.text, at.offset)

    def here(self, state: State) -> str:
        """The folder relative paths start from."""
        values = state.get("CMAKE_CURRENT_SOURCE_DIR")
        return values[0] or ROOT if len(values) == 1 else UNKNOWN

    def values(self, argument: Argument, state: State) -> tuple[str, ...]:
        """What an argument may stand for; names of interface files in it are remembered with their place."""
        found = expand(argument, state, self.meter)
        for text in found:
            self.meter.spend(len(text))
            for item in items(text):
                if item.endswith(INTERFACE_SUFFIXES):
                    self.places.setdefault(item, self.place(argument))
        return found

    def joined(self, arguments: tuple[Argument, ...], state: State) -> tuple[str, ...]:
        """Arguments as one list."""
        found: tuple[str, ...] = ("",)
        for argument in arguments:
            found = combine(found, self.values(argument, state), ";", self.meter)
        return found

    def exists(self, path: str) -> bool | None:
        """Whether a path of the package exists; None for other places, and for what a command may have made."""
        whole = inside(path)
        if whole is None:
            return None
        real = os.path.realpath(self.folder / whole[len(ROOT) + 1 :])
        if not Path(real).is_relative_to(os.path.realpath(self.folder)):
            return None
        return True if os.path.exists(real) else None if self.changed else False

    # --- commands -------------------------------------------------------------------------------------------------

    def _set(self, command: Command, state: State) -> None:
        name = self._target(command, state)
        if name is None or name.startswith(("ENV{", "CACHE{")):
            return
        rest = command.arguments[1:]
        words = [argument.text if argument.kind == "word" else "" for argument in rest]
        outside = bool(words) and words[-1] == "PARENT_SCOPE"
        if outside:
            rest = rest[:-1]
        elif "CACHE" in words:
            if words[-1] != "FORCE" and state.get(name) not in (UNDEFINED, UNKNOWN_VALUE):
                return
            rest = rest[: words.index("CACHE")]
        state.set(name, self.joined(rest, state) if rest else UNDEFINED, outside)

    def _unset(self, command: Command, state: State) -> None:
        name = self._target(command, state)
        if name is not None:
            state.set(name, UNDEFINED, command.arguments[-1].text == "PARENT_SCOPE")

    def _option(self, command: Command, state: State) -> None:
        """An option has its default: a build without settings is what is looked at."""
        name = self._target(command, state)
        if name is not None and state.get(name) in (UNDEFINED, UNKNOWN_VALUE):
            state.set(name, self.values(command.arguments[2], state) if len(command.arguments) > 2 else ("OFF",))

    def _project(self, command: Command, state: State) -> None:
        name = self._target(command, state)
        if name is not None:
            here = state.get("CMAKE_CURRENT_SOURCE_DIR")
            for variable in ("PROJECT_NAME", "CMAKE_PROJECT_NAME"):
                state.set(variable, [name])
            for variable in ("PROJECT_SOURCE_DIR", f"{name}_SOURCE_DIR"):
                state.set(variable, here)

    def _find_package(self, command: Command, state: State) -> None:
        """What the file itself needs is there: a build without it would end here."""
        name = self._target(command, state)
        if name is not None:
            required = any(argument.text == "REQUIRED" for argument in command.arguments)
            known = ("TRUE",) if required or name.startswith(_FOUND) else UNKNOWN_VALUE
            state.set(f"{name}_FOUND", ("FALSE",) if name in _NOT_FOUND else known)

    def _target(self, command: Command, state: State, index: int = 0) -> str | None:
        """The name of the variable a command sets; None when it cannot be known."""
        if len(command.arguments) <= index:
            return None
        names = expand(command.arguments[index], state, self.meter)
        return names[0] if len(names) == 1 and UNKNOWN not in names[0] else None

    def _list(self, command: Command, state: State) -> None:
        name = self._target(command, state, 1)
        if name is None:
            return
        action = command.arguments[0].text.upper()
        rest, old = command.arguments[2:], tuple(value or "" for value in state.get(name))
        match action:
            case "APPEND":
                state.set(name, combine(old, self.joined(rest, state), ";", self.meter))
            case "PREPEND":
                state.set(name, combine(self.joined(rest, state), old, ";", self.meter))
            case "INSERT":
                state.set(name, combine(old, self.joined(rest[1:], state), ";", self.meter))  # order does not matter
            case "REMOVE_ITEM":
                self._remove(name, old, rest, state)
            case "FILTER":
                self._filter(name, old, rest, state)
            case "TRANSFORM":
                self._transform(name, old, rest, state)
            case "REMOVE_DUPLICATES" | "SORT" | "REVERSE":
                pass
            case _:
                self.forget(command, state)

    def _remove(self, name: str, old: tuple[str, ...], rest: tuple[Argument, ...], state: State) -> None:
        texts = self.joined(rest, state)
        if len(texts) != 1 or UNKNOWN in texts[0]:
            state.set(name, UNKNOWN_VALUE)
            return
        self.meter.spend(10 * sum(map(len, old)))
        gone = frozenset(items(texts[0]))
        state.set(name, [";".join(item for item in items(text) if item not in gone) for text in old])

    def _filter(self, name: str, old: tuple[str, ...], rest: tuple[Argument, ...], state: State) -> None:
        words = [argument.text for argument in rest]
        known = len(words) == 3 and words[0] in ("INCLUDE", "EXCLUDE") and words[1] == "REGEX"
        texts = expand(rest[2], state, self.meter) if known else ()
        answers = {item: matches(texts[0], item, self.meter) for text in old for item in items(text) if len(texts) == 1}
        if len(texts) != 1 or UNKNOWN in texts[0] or None in answers.values():
            state.set(name, UNKNOWN_VALUE)
            return
        wanted = words[0] == "INCLUDE"
        state.set(name, [";".join(item for item in items(text) if answers[item] is wanted) for text in old])

    def _transform(self, name: str, old: tuple[str, ...], rest: tuple[Argument, ...], state: State) -> None:
        action = rest[0].text if len(rest) == 2 else ""
        texts = expand(rest[1], state, self.meter) if action in ("PREPEND", "APPEND") else ()
        if len(texts) != 1:
            state.set(name, UNKNOWN_VALUE)
            return
        before, behind = (texts[0], "") if action == "PREPEND" else ("", texts[0])
        self.meter.spend(sum(len(text) + len(items(text)) * len(texts[0]) for text in old))
        state.set(name, [";".join(before + item + behind for item in items(text)) for text in old])

    def _file(self, command: Command, state: State) -> None:
        action = command.arguments[0].text.upper() if command.arguments else ""
        if action not in ("GLOB", "GLOB_RECURSE"):
            self.changed = self.changed or action not in _READING
            self.forget(command, state)
            return
        name = self._target(command, state, 1)
        if name is None:
            return
        base = ""
        patterns: list[str] = []
        waiting = iter(command.arguments[2:])
        for argument in waiting:
            if argument.kind == "word" and argument.text in ("RELATIVE", "LIST_DIRECTORIES"):
                value = self.joined((next(waiting, argument),), state)
                base = value[0] if argument.text == "RELATIVE" else base
            elif argument.text not in ("CONFIGURE_DEPENDS", "FOLLOW_SYMLINKS"):
                patterns += [one for text in expand(argument, state, self.meter) for one in items(text)]
        found = self._globbed(patterns, self.here(state), base, action == "GLOB_RECURSE")
        state.set(name, [";".join([*found, UNKNOWN] if self.changed else found)])

    def _globbed(self, patterns: list[str], here: str, base: str, deep: bool) -> list[str]:
        start = inside(base, here) if base else ""
        wholes = [inside(pattern, here) for pattern in patterns]
        if start is None:
            return [UNKNOWN]
        found: list[str] = []
        for whole in wholes:
            paths = None if whole is None else glob(self.folder, whole[len(ROOT) + 1 :], deep, self.meter)
            if paths is None:
                found.append(UNKNOWN)
            else:
                full = [f"{ROOT}/{path}" for path in paths]
                found += [posixpath.relpath(path, start) for path in full] if start else full
        return sorted(set(found))
