"""Record the public API in `tests/golden/public_face.txt` and print the changes.

Run it as ``python tools/record_public_api.py``.

`docs/reference/versions.md` promises not to change it silently, and `test_public_face.py` compares. It is what the
pages of `docs/reference/api` show, read by griffe as these pages are made, without importing anything; the fixtures
for pytest; and the commands with their options. What generated modules have is in `golden/generated`.
"""

from __future__ import annotations

import difflib
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import griffe
import yaml

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[1]
RECORD = ROOT / "tests/golden/public_face.txt"
PROGRAMS = {"rosidl-py-gen": "rosidl_py_gen.generator_cli", "rosidl-py": "rosidl_py_gen.ros_cli"}
FIXTURES = "runtime.pytest_plugin"
PACKAGE = "rosidl_py_gen"
_SHOWN = re.compile(rf"^::: {PACKAGE}\.(\S+)\n((?: {{4}}.*\n)*)", re.MULTILINE)

_STATEMENTS = {"__enter__": "with", "__aenter__": "async with", "__iter__": "for", "__aiter__": "async for"}


def face() -> str:
    """Return the whole record."""
    package = griffe.load(PACKAGE, search_paths=[str(ROOT)], try_relative_path=False)
    pages = {page.name: page.read_text(encoding="utf-8") for page in sorted((ROOT / "docs/reference/api").glob("*.md"))}
    public = {name.rpartition(".")[2] for text in pages.values() for name, _ in _SHOWN.findall(text)}
    lines = []
    for page, text in pages.items():
        lines += ["", f"# docs/reference/api/{page}"]
        for name, options in sorted(_SHOWN.findall(text)):
            settings = (yaml.safe_load(options) or {}).get("options", {})
            lines += _entry(name, _target(package[name]), settings, public)
    lines += ["", f"# {PACKAGE}.{FIXTURES}", *_fixtures(package[FIXTURES])]
    for program, module in PROGRAMS.items():
        lines += ["", f"# {program} --help", *_commands(program, _group(import_module(module)))]
    return "\n".join(lines[1:]) + "\n"


def all_untold() -> list[str]:
    """Yield public members of documented classes that have no description."""
    package = griffe.load(PACKAGE, search_paths=[str(ROOT)], try_relative_path=False)
    pages = [page.read_text(encoding="utf-8") for page in sorted((ROOT / "docs/reference/api").glob("*.md"))]
    lines = []
    for name, options in (entry for text in pages for entry in _SHOWN.findall(text)):
        settings = (yaml.safe_load(options) or {}).get("options", {})
        found = _target(package[name])
        if found.is_class and not settings.get("show_if_no_docstring", False):
            lines += [f"{name}.{member}" for member in _untold(found, settings)]
    return lines


def difference(recorded: str, found: str) -> list[str]:
    """The lines that are not in both, as a diff has them; members with their class."""
    lines = list(difflib.unified_diff(list(_placed(recorded)), list(_placed(found)), n=0, lineterm=""))[2:]
    return [line for line in lines if not line.startswith("@@")]


def _placed(record: str) -> Iterator[str]:
    owner = ""
    for line in record.splitlines():
        if line.startswith("    "):
            yield f"{owner}: {line.strip()}"
        else:
            owner = line.partition("(")[0]
            yield line


# ---------------------------------------------------------------------------------------------------------- API pages


def _target(found: Any) -> Any:
    return found.final_target if found.is_alias else found


def _entry(name: str, found: Any, settings: dict[str, Any], public: set[str]) -> Iterator[str]:
    """A function; or a class, its constructor unless the page hides that, what statements take it, and its members."""
    if not found.is_class:
        yield from _member(name, found) if found.is_function else [f"{name} = {found.value}"]
        return
    bases = [str(base) for base in found.bases if _is_told(base, public)]
    yield f"class {name}" + (f"({', '.join(bases)})" if bases else "")
    if made := settings.get("merge_init_into_class", True) and _constructor(found):
        yield f"    {made}"
    if allowed := [statement for method, statement in _STATEMENTS.items() if method in found.all_members]:
        yield f"    ({', '.join(allowed)})"
    for member, value in _members(found, settings, every=not made and "dataclass" in found.labels):
        yield from (f"    {line}" for line in _member(member, value))


def _is_told(base: Any, public: set[str]) -> bool:
    """A base is part of the face when users can name it: one of Python's, or on a page."""
    name = str(getattr(base, "canonical_path", base))
    return name.rpartition(".")[2] in public or not name.startswith((f"{PACKAGE}.", "typing.Generic", "Generic"))


def _constructor(found: Any) -> str:
    if "dataclass" in found.labels:
        return str(found.signature(name="__init__"))
    made = found.all_members.get("__init__")
    return str(_target(made).signature(name="__init__")).removesuffix(" -> None") if made else ""


def _members(found: Any, settings: dict[str, Any], *, every: bool) -> list[tuple[str, Any]]:
    """Return members that the page shows: with docstring, without underscore, and their forms with `_sync`."""
    inherited = settings.get("inherited_members", True)
    known = found.all_members if inherited is True else {*found.members, *inherited}
    chosen = [name for name in settings.get("members", known) if not name.startswith("_")]
    named = {name: _target(found.all_members[name]) for name in chosen}
    is_tuple = "NamedTuple" in map(str, found.bases)  # the order of its fields counts
    every = every or is_tuple or settings.get("show_if_no_docstring", False)
    shown = [(name, one) for name, one in named.items() if every or named[_awaitable(name, named)].docstring]
    return shown if is_tuple else sorted(shown)


def _untold(found: Any, settings: dict[str, Any]) -> list[str]:
    """Return public members of a class without docstring, field, or mention in the class docstring."""
    words = set(re.findall(r"\w+", found.docstring.value if found.docstring else ""))
    fields = "dataclass" in found.labels
    told = {name for name, _ in _members(found, settings, every=False)}
    return [
        name
        for name, one in _members(found, settings, every=True)
        if name not in told | words and not (fields and one.is_attribute)
    ]


def _awaitable(name: str, named: dict[str, Any]) -> str:
    """Return the async method whose blocking form is `name`, or `name` if there is none."""
    form = name.removesuffix("_sync")
    return form if form in named else name


def _member(name: str, found: Any) -> Iterator[str]:
    if found.is_attribute:
        yield f"{name}: {found.annotation}" if found.annotation else name
        return
    for one in found.overloads or [found]:
        kind = "async def" if "async" in found.labels else "def"
        yield f"{kind} {one.signature(return_type=True, name=name)}"


# ----------------------------------------------------------------------------------------------- fixtures and commands


def _fixtures(module: Any) -> list[str]:
    return [f"{name}: {one.returns}" for name, one in sorted(module.members.items()) if name.startswith("ros_")]


def _group(module: Any) -> Any:
    """The group of all commands of a command line."""
    return module.root() if hasattr(module, "root") else module.cli


def _commands(name: str, command: click.Command) -> Iterator[str]:
    if not isinstance(command, click.Group) or command.invoke_without_command:
        yield name
        yield from (f"    {_parameter(one)}" for one in command.params)
    if isinstance(command, click.Group):
        context = click.Context(command)
        for child in command.list_commands(context):
            found = command.get_command(context, child)
            assert found is not None
            yield from _commands(f"{name} {child}", found)


def _parameter(parameter: click.Parameter) -> str:
    """Return the spellings of a parameter, and the values that it takes."""
    if isinstance(parameter, click.Argument):
        return f"{parameter.human_readable_name}{'' if parameter.required else ' (optional)'}"
    spelled = ", ".join([*parameter.opts, *parameter.secondary_opts])
    assert isinstance(parameter, click.Option)
    if parameter.is_flag or parameter.count:
        return spelled
    choices = parameter.type.choices if isinstance(parameter.type, click.Choice) else ()
    takes = "|".join(map(str, choices)) or parameter.metavar or parameter.type.name.upper()
    return f"{spelled} {takes}{' ...' if parameter.multiple else ''}"


def main() -> None:
    recorded, found = RECORD.read_text(encoding="utf-8") if RECORD.exists() else "", face()
    RECORD.write_text(found, encoding="utf-8", newline="\n")
    print(*difference(recorded, found) or ["nothing changed"], sep="\n")


if __name__ == "__main__":
    sys.exit(main())
