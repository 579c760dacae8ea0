"""Reference compilers as oracles: two releases of the rosidl tool chain, and the comparison with ours.

They come from PyPI (tests/support/environments.py), each into an environment of its own, and answer as processes that
stay (tests/support/rosidl_server.py). All are asked at once, and a test holds for all of them: where releases
differ, or we differ from them on purpose, a table in the tests says so.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import sqlite3
import subprocess
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from hypothesis import currently_in_test_context

from rosidl_py_gen.base.descriptions import TypeDescriptions
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.base.resources import DataFolders
from rosidl_py_gen.compiler.frontend.interface_parser import may_be_file
from rosidl_py_gen.compiler.frontend.model import (
    ActionDef,
    ConstantDef,
    FieldDef,
    Interface,
    MessageDef,
    ServiceDef,
    SourceText,
)
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry, check
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from rosidl_py_gen.errors import InvalidNameError
from support.environments import cache_folder, environment

_SERVER = Path(__file__).with_name("rosidl_server.py")
RELEASES = {"jazzy": ("4.6.6", "1.8.1"), "kilted": ("4.9.5", "1.11.0")}  # rosidl, ament_index_python

# name, text, format
Definition = tuple[str, str, str]
Reply = dict[str, Any]

# Definitions that tests may refer to, in addition to the bundled packages and each other.
OTHERS: list[Definition] = [
    ("a_msgs/msg/Other", "uint8 x\nb_msgs/Other y", "msg"),
    ("b_msgs/msg/Other", "string<=3[<=2] z", "msg"),
    ("a_msgs/srv/Ask", "uint8 x\n---", "srv"),
]
_IMPLIED = ("builtin_interfaces/msg/Time", "unique_identifier_msgs/msg/UUID", "service_msgs/msg/ServiceEventInfo")


def requirements(release: str) -> list[str]:
    rosidl, index = RELEASES[release]
    parts = ("adapter", "cli", "generator-type-description", "parser")
    return [
        *(f"ros-rosidl-{part}=={rosidl}" for part in parts),
        f"ros-ament-index-python=={index}",
        *("empy==4.2.1", "lark-parser==0.12.0"),
    ]


def _quiet() -> dict[str, str]:
    """No ROS installation of the user's; and one hash seed, on which the answers about ambiguous .idl depend."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    return {**inherited, "PYTHONHASHSEED": "0"}


class _Release:
    """Reference compiler of a release: a process that starts with the first question that is not in the cache.

    Answers are cached by release, server and question. Answers to random examples are not cached.
    """

    def __init__(self, release: str, context: str) -> None:
        self._python = environment(f"rosidl-{release}", requirements(release))
        self._context = context
        self._process: subprocess.Popen[str] | None = None
        what = "\n".join((*requirements(release), _SERVER.read_text(encoding="utf-8"), context))
        name = f"rosidl-{release}-{hashlib.sha256(what.encode()).hexdigest()[:12]}.sqlite"
        self._kept = sqlite3.connect(cache_folder() / name, timeout=60, isolation_level=None)
        self._kept.execute("PRAGMA synchronous=OFF")
        self._kept.execute("CREATE TABLE IF NOT EXISTS replies (question BLOB PRIMARY KEY, reply TEXT)")

    def kept(self, line: str) -> str | None:
        """Return the cached answer of an earlier run."""
        found = self._kept.execute("SELECT reply FROM replies WHERE question = ?", (_key(line),)).fetchone()
        return None if found is None else str(found[0])

    def ask(self, line: str) -> None:
        """Send a question; `answer` waits for the reply."""
        if self._process is None:
            self._process = subprocess.Popen(
                [str(self._python), "-s", str(_SERVER)],
                env=_quiet(),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                encoding="utf-8",
            )
            self.ask(self._context)
            self.answer(self._context)
        assert self._process.stdin is not None
        self._process.stdin.write(line)
        self._process.stdin.flush()

    def answer(self, line: str) -> str:
        """Return the answer to the last question."""
        assert self._process is not None and self._process.stdout is not None
        reply = self._process.stdout.readline()
        assert reply, "the rosidl process ended"
        same_every_time = "ROSIDL_TEST_REQUIRE_PEERS" in os.environ and not os.environ.get("ROSIDL_TEST_SEED")
        if not currently_in_test_context() or same_every_time:
            self._kept.execute("INSERT OR REPLACE INTO replies VALUES (?, ?)", (_key(line), reply))
        return reply

    def close(self) -> None:
        self._kept.close()
        if self._process is not None:
            self._process.communicate(timeout=60)


def _key(line: str) -> bytes:
    return hashlib.sha256(line.encode()).digest()


def _question(definitions: Sequence[Definition], keep: bool = False) -> str:
    rows = []
    for name, text, format in definitions:
        package, kind, stem = name.split("/")
        rows.append({"package": package, "kind": kind, "name": stem, "format": format, "text": text})
    return json.dumps({"definitions": rows, "keep": keep}) + "\n"


class Rosidl:
    """All releases of the tool chain; see rosidl_server.py."""

    def __init__(self) -> None:
        implied = [
            (name, (DataFolders.interfaces() / f"{name}.msg").read_text(encoding="utf-8"), "msg") for name in _IMPLIED
        ]
        context = _question([*implied, *OTHERS], keep=True)
        self._releases = {release: _Release(release, context) for release in RELEASES}

    def compile(self, definitions: Sequence[Definition]) -> dict[str, Reply]:
        """Return the results of the tool chain for definitions that belong together, by release."""
        line = _question(definitions)
        replies = {name: release.kept(line) for name, release in self._releases.items()}
        missing = [name for name, reply in replies.items() if reply is None]
        for name in missing:
            self._releases[name].ask(line)
        replies.update((name, self._releases[name].answer(line)) for name in missing)
        return {name: json.loads(reply) for name, reply in replies.items() if reply is not None}

    def close(self) -> None:
        for release in self._releases.values():
            release.close()


# --- our side, in the form the oracle answers in ----------------------------------------------------------------------

_EMPTY = [["structure_needs_at_least_one_member", [3, 0, 0, ""], None]]
_IDL_TYPES = {
    "char": "uint8",
    "idl_char": "char",
    "byte": "octet",
    "bool": "boolean",
    "float32": "float",
    "float64": "double",
    "wstring": "string",
}


def ours(definitions: Sequence[Definition], others: Sequence[Definition] = ()) -> Reply:
    """Our reply. "refused" is a definition that is wrong alone, "unresolved" one that goes wrong with the others."""
    library = InterfaceRegistry(_search())
    for name, text, format in others:
        library.add_text(RosName.parse(name), SourceText("<other>", text, format))
    try:
        names = [RosName.parse(name) for name, _, _ in definitions]
    except InvalidNameError as error:
        return {"refused": [str(error)]}
    if not all(map(may_be_file, names)):
        return {"refused": ["names no file can have"]}
    found = [
        library.add_text(name, SourceText(f"<{name}>", text, format))
        for name, (_, text, format) in zip(names, definitions, strict=True)
    ]
    if library.diagnostics.items:
        return {"refused": [str(problem) for problem in library.diagnostics.items]}
    interfaces = [one for one in found if one is not None]
    reply: Reply = {"messages": [plain(one) for one in interfaces]}
    check(library, names)
    if library.diagnostics.items:
        return {**reply, "unresolved": [str(problem) for problem in library.diagnostics.items]}
    types = [name for one in interfaces for name in type_names(one)]
    return {
        **reply,
        "types": {
            name: [TypeDescriptions.of_fields(name, library.field_rows(name)), library.type_hash(name)]
            for name in types
        },
    }


@lru_cache(maxsize=1)
def _search() -> SearchPath:
    return SearchPath.scan([DataFolders.interfaces()], ament="", bundled=False)


def type_names(interface: Interface) -> list[str]:
    """Return the names of all types that a file defines."""
    name = str(interface.name)
    match interface:
        case MessageDef():
            return [name]
        case ServiceDef():
            return [name, *(f"{name}_{part}" for part in ("Request", "Response", "Event"))]
        case ActionDef():
            parts = [f"{name}_{part}" for part in ("Goal", "Result", "Feedback", "FeedbackMessage")]
            return [name, *parts, *type_names(interface.send_goal), *type_names(interface.get_result)]


def authored(interface: Interface) -> tuple[MessageDef, ...]:
    """Return the messages of a definition without derived messages."""
    match interface:
        case MessageDef():
            return (interface,)
        case ServiceDef():
            return interface.request, interface.response
        case ActionDef():
            return interface.goal, interface.result, interface.feedback


def plain(interface: Interface) -> list[dict[str, Any]]:
    return [
        {
            "fields": [_field(item) for item in one.fields] or _EMPTY,
            "constants": [_constant(item) for item in one.constants],
        }
        for one in authored(interface)
    ]


def _field(item: FieldDef) -> list[Any]:
    row = list(item.type.description().values())
    default = item.default
    if isinstance(default, tuple):
        return [item.name, row, {"value": [_floaty(value) for value in default]}]
    return [item.name, row, None if default is None else {"value": _floaty(default)}]


def _constant(item: ConstantDef) -> list[Any]:
    return [item.name, _IDL_TYPES.get(item.type.base, item.type.base), _floaty(item.value)]


def _floaty(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else "inf"
    return value


# --- the comparison ---------------------------------------------------------------------------------------------------


def compare(rosidl: Rosidl, text: str, name: str = "a_msgs/msg/Sample", format: str = "") -> None:
    compare_world(rosidl, [(name, text, format or RosName.parse(name).kind)])


def compare_world(rosidl: Rosidl, definitions: Sequence[Definition]) -> Reply:
    """Every release refuses what we refuse, and otherwise has the same fields, constants, descriptions and hashes.

    Returns:
        our reply.
    """
    mine = ours(definitions, OTHERS)
    for release, theirs in rosidl.compile(definitions).items():
        difference = different(mine, theirs)
        assert not difference, f"{release}: {difference}, in {definitions!r}"
    return mine


def different(mine: Reply, theirs: Reply, loose: bool = False) -> str:
    """Return the difference between our reply and the oracle's reply; "" if they agree.

    Args:
        loose: numbers count, and not whether they are written as 1, 1.0 or TRUE.
    """
    if "messages" in mine and "messages" in theirs:
        # repr: True is not 1, and -0.0 not 0.0
        one, other = (reply["messages"] if loose else repr(reply["messages"]) for reply in (mine, theirs))
        if one != other:
            return f"read {mine['messages']}, and rosidl {theirs['messages']}"
    if "types" in mine and not accepted(theirs):
        return f"accepted what rosidl refuses: {theirs.get('refused', 'types without a hash')}"
    if "types" not in mine:
        problems = mine.get("refused") or mine["unresolved"]
        return f"refused what rosidl accepts: {problems}" if accepted(theirs) else ""
    for name in mine["types"].keys() | theirs["types"].keys():
        sides = [_described(reply["types"].get(name), loose) for reply in (mine, theirs)]
        if sides[0] != sides[1]:
            return f"described {name} as {sides[0]}, and rosidl as {sides[1]}"
    return ""


def accepted(theirs: Reply) -> bool:
    return "refused" not in theirs and all(type_hash for _, type_hash in theirs["types"].values())


def _described(row: list[Any] | None, loose: bool) -> object:
    if row is None:
        return None
    description, type_hash = row
    fields = [{**field, "default_value": _unsigned(field["default_value"], loose)} for field in description["fields"]]
    return {**description, "fields": fields}, type_hash


def _unsigned(default: str, loose: bool) -> str:
    """The reference loses the sign of an infinity, see `_floaty`."""
    return "" if loose else default.replace("-inf", "inf")
