"""Follows a package's CMakeLists.txt to its `rosidl_generate_interfaces` calls, without running anything.

Decides what the calls list as far as the text tells. A condition that cannot be decided is followed both ways; a block
that cannot be followed makes what it sets unknown. Files are read only inside the package folder: other CMake files it
includes, and the names `file(GLOB)` asks for.
"""

from __future__ import annotations

import os
import posixpath
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.spec.cmake_commands import Commands, Place
from rosidl_py_gen.spec.cmake_if import Term, holds
from rosidl_py_gen.spec.cmake_text import (
    MAX_BYTES,
    Argument,
    Block,
    Command,
    Node,
    UnreadableError,
    every_command,
    parse_cmake,
)
from rosidl_py_gen.spec.cmake_values import ROOT, UNKNOWN, State, expand, inside, items, join

if TYPE_CHECKING:
    from collections.abc import Sequence

GENERATE = "rosidl_generate_interfaces"
_MAX_DEPTH = 40  # blocks and calls inside one another; each costs a few frames of the interpreter's stack
_ASSIGNING = frozenset({"set", "unset", "option", "list", "file", "string", "foreach", "get_filename_component"})


@dataclass(frozen=True, slots=True)
class Listed:
    """One argument of a call.

    Attributes:
        texts: the elements it may bring, one tuple for each way the build may go.
        written: as it stands in the file.
        place: where.
        folder: what relative paths start from, below `ROOT`.
    """

    texts: tuple[tuple[str, ...], ...]
    written: str
    place: Place
    folder: str


@dataclass(frozen=True, slots=True)
class Call:
    """One call: its arguments behind the target name; `certain` says that every build comes past it."""

    place: Place
    certain: bool
    arguments: tuple[Listed, ...]


@dataclass(slots=True)
class _Exits:
    """Where the ways of a run wait that left a loop, a function or a file early."""

    broken: list[State] = field(default_factory=list)
    continued: list[State] = field(default_factory=list)
    returned: list[State] = field(default_factory=list)


def follow(folder: Path) -> tuple[list[Call], dict[str, Place]]:
    """Follow the CMakeLists.txt of a package folder.

    Returns:
        The calls in the order they were reached, and for names of interface files where each was first written.

    Raises:
        UnreadableError: what it does cannot be known.
    """
    state = State(set())
    for name in ("CMAKE_SOURCE_DIR", "PROJECT_SOURCE_DIR", "CMAKE_CURRENT_SOURCE_DIR"):
        state.set(name, [ROOT])
    state.set("ROS_VERSION", ["2"])
    runner = _Runner(folder)
    try:
        runner.run_file("CMakeLists.txt", state)
    except UnreadableError as error:
        error.path, error.text = runner.path, runner.text
        raise
    return runner.calls, runner.places


class _Runner(Commands):
    """Runs files, blocks and calls."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.calls: list[Call] = []
        self.functions: dict[str, tuple[Block, str, str]] = {}  # with the file it stands in, and its text
        self.doubts = 0  # conditions around this point that could not be decided
        self.depth = 0
        self.exits = _Exits()

    # --- files ----------------------------------------------------------------------------------------------------

    def run_file(self, path: str, state: State) -> State | None:
        """Run a file of the package; None when every way through it ends the run."""
        outer = self.path, self.text
        self.path, self.text = path, self.read(path)
        nodes = parse_cmake(self.text)
        for command in every_command(nodes):
            if command.name in _ASSIGNING:
                state.own.update(one.text for one in command.arguments if one.text.isidentifier())
        state.set("CMAKE_CURRENT_LIST_DIR", [posixpath.dirname(f"{ROOT}/{path}")])
        after = self.body(nodes, state)
        self.path, self.text = outer
        if after is not None:
            after.set("CMAKE_CURRENT_LIST_DIR", [posixpath.dirname(f"{ROOT}/{self.path}")])
        return after

    def read(self, path: str) -> str:
        real = os.path.realpath(self.folder / path)
        if not Path(real).is_relative_to(os.path.realpath(self.folder)):
            raise UnreadableError("the file lies outside the package folder")
        try:
            with open(real, "rb") as file:
                raw = file.read(MAX_BYTES + 1)
        except OSError as error:
            raise UnreadableError(f"the file cannot be read: {error.strerror or error}") from error
        if len(raw) > MAX_BYTES:
            raise UnreadableError(f"the file is longer than {MAX_BYTES} bytes")
        self.meter.spend(len(raw))
        return raw.decode(errors="replace").replace("\0", "\ufffd").replace("\1", "\ufffd")

    def include(self, command: Command, state: State) -> State | None:
        """Run another CMake file of the package; modules of CMake and of packages set nothing that is asked for."""
        values = expand(command.arguments[0], state, self.meter) if command.arguments else ()
        path = inside(values[0], self.here(state)) if len(values) == 1 else None
        if path is None or path == ROOT:
            return state
        folder = command.name == "add_subdirectory"
        relative = path[len(ROOT) + 1 :] + ("/CMakeLists.txt" if folder else "")
        if not self.exists(f"{ROOT}/{relative}"):
            return state
        if not folder:
            return self.run_file(relative, state)
        state.frames.append({**state.frames[-1], "CMAKE_CURRENT_SOURCE_DIR": (path,)})
        after = self.run_file(relative, state)
        if after is not None:
            after.frames.pop()
        return after

    # --- blocks ---------------------------------------------------------------------------------------------------

    def run(self, nodes: Sequence[Node], state: State | None) -> State | None:
        self.depth += 1
        if self.depth > _MAX_DEPTH:
            raise UnreadableError("blocks and calls are nested too deeply")
        for node in nodes:
            if state is None:
                break
            self.meter.spend(1)
            state = self.command(node, state) if isinstance(node, Command) else self.block(node, state)
        self.depth -= 1
        return state

    def body(self, nodes: Sequence[Node], state: State) -> State | None:
        """Run what return() leaves: a file, a function."""
        outer, self.exits = self.exits, _Exits()
        after = join([self.run(nodes, state), *self.exits.returned], self.meter)
        self.exits = outer
        return after

    def block(self, block: Block, state: State) -> State | None:
        kind = block.head.name
        if kind == "if":
            return self.choose(block, state)
        if kind == "foreach":
            return self.repeat(block, state)
        if kind in ("function", "macro"):
            if block.head.arguments:
                self.functions[block.head.arguments[0].text.lower()] = (block, self.path, self.text)
            return state
        return self.give_up(block, state)

    def choose(self, block: Block, state: State) -> State | None:
        """Run the branch that is taken, or all that may be."""
        ends: list[State | None] = []
        doubts = self.doubts
        for head, body in block.parts:
            terms = [
                Term(expand(one, state, self.meter), one.kind in ("quoted", "bracket"), "$" not in one.text)
                for one in head.arguments
            ]
            answer = True if head.name == "else" else holds(terms, state, self.exists, self.meter)
            if answer:
                ends.append(self.run(body, state))
                break
            if answer is None:
                self.doubts = doubts + 1
                ends.append(self.run(body, state.fork(self.meter)))
        else:
            ends.append(state)
        self.doubts = doubts
        return join(ends, self.meter)

    def repeat(self, block: Block, state: State) -> State | None:
        """Run a foreach over items that are all known."""
        elements = self.elements(block.head, state)
        if elements is None:
            return self.give_up(block, state)
        outer, self.exits = self.exits, _Exits(returned=self.exits.returned)
        now: State | None = state
        for element in elements:
            if now is None:
                break
            now.set(block.head.arguments[0].text, [element])
            now = join([self.run(block.body, now), *self.exits.continued], self.meter)
            self.exits.continued.clear()
        after = join([now, *self.exits.broken], self.meter)
        self.exits = outer
        return after

    def elements(self, head: Command, state: State) -> list[str] | None:
        found: list[str] = []
        mode = "ITEMS"
        for argument in head.arguments[1:]:
            if argument.kind == "word" and argument.text in ("IN", "LISTS", "ITEMS", "RANGE", "ZIP_LISTS"):
                mode = argument.text
                continue
            values = self.values(argument, state)
            if mode == "LISTS":
                values = tuple(value or "" for text in values for value in state.get(text))
            if len(values) != 1 or UNKNOWN in values[0] or mode in ("RANGE", "ZIP_LISTS"):
                return None
            found += items(values[0])
        return found if head.arguments else None

    def give_up(self, block: Block, state: State) -> State:
        """A block that cannot be followed: what it sets is unknown behind it."""
        for command in every_command([block]):
            self.meter.spend(len(command.arguments))
            if command.name == GENERATE:
                raise UnreadableError(f"what this {block.head.name}() goes through cannot be known", block.head.offset)
            self.forget(command, state)
        return state

    # --- commands and calls ---------------------------------------------------------------------------------------

    def command(self, command: Command, state: State) -> State | None:
        name = command.name
        if name == GENERATE:
            self.generate(command, state)
        elif name in self.functions:
            return self.call(command, state)
        elif name in ("include", "add_subdirectory"):
            return self.include(command, state)
        elif name in ("break", "continue", "return"):
            left = {"break": self.exits.broken, "continue": self.exits.continued, "return": self.exits.returned}
            left[name].append(state)
            return None
        elif name == "message" and command.arguments and command.arguments[0].text == "FATAL_ERROR":
            return None  # a build that comes here makes nothing
        else:
            self.simple(command, state)
        return state

    def generate(self, command: Command, state: State) -> None:
        listed = []
        for argument in command.arguments[1:]:
            texts = tuple(tuple(items(value)) for value in self.values(argument, state))
            self.meter.spend(20 * sum(map(len, texts)))
            listed.append(Listed(texts, argument.text, self.place(argument), self.here(state)))
        self.calls.append(Call(self.place(command), self.doubts == 0, tuple(listed)))

    def call(self, command: Command, state: State) -> State | None:
        """Call a function or macro of the file; a macro's parameters are taken for variables."""
        block, path, text = self.functions[command.name]
        words = [word for argument in command.arguments for word in self.words(argument, state)]
        names = [argument.text for argument in block.head.arguments[1:]]
        given = {name: words[index] if index < len(words) else "" for index, name in enumerate(names)}
        given |= {"ARGN": ";".join(words[len(names) :]), "ARGV": ";".join(words), "ARGC": str(len(words))}
        is_function = block.head.name == "function"
        if is_function:
            self.meter.spend(20 * len(state.frames[-1]))
            state.frames.append(dict(state.frames[-1]))
        for name, value in given.items():
            state.own.add(name)
            state.set(name, [value])
        outer, (self.path, self.text) = (self.path, self.text), (path, text)
        after = self.body(block.body, state)
        self.path, self.text = outer
        if after is not None and is_function:
            after.frames.pop()
        return after

    def words(self, argument: Argument, state: State) -> list[str]:
        values = self.values(argument, state)
        if len(values) > 1:
            return [UNKNOWN]
        return [values[0]] if argument.kind != "word" else items(values[0])
