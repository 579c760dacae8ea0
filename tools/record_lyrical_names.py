"""Record the public names of Lyrical's rclpy that Jazzy's does not have, in `tests/golden/rclpy_names_lyrical.json`.

Run it as ``python tools/record_lyrical_names.py SOURCE``.

SOURCE is the source of rclpy 10, for example the branch release/lyrical/rclpy of github.com/ros2-gbp/rclpy-release. It
is read and not run, because no package index has it. The record has names that programs can import or call, and the
functions with more parameters than in Jazzy, as name -> parameters, or null for what is not a function. Names that a
module only imports are left out.
"""

from __future__ import annotations

import ast
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

GOLDEN = Path(__file__).resolve().parents[1] / "tests" / "golden"
RECORD = GOLDEN / "rclpy_names_lyrical.json"
Members = dict[str, "list[str] | None"]


def _parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Return the names, with ``=`` behind those that have a default."""
    every = function.args
    plain = [*every.posonlyargs, *every.args]
    with_default = {one.arg for one in plain[len(plain) - len(every.defaults) :]}
    with_default |= {one.arg for one, value in zip(every.kwonlyargs, every.kw_defaults, strict=True) if value}
    names = [one.arg for one in (*plain, every.vararg, *every.kwonlyargs, every.kwarg) if one is not None]
    return [f"{name}=" if name in with_default else name for name in names]


def _statements(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    for statement in body:
        if isinstance(statement, ast.If) and "TYPE_CHECKING" not in ast.unparse(statement.test):
            yield from _statements(statement.body)
        yield statement


def _names(body: list[ast.stmt], *, is_package: bool = False) -> dict[str, ast.stmt]:
    """Return the public names of a module or class, and the statement that defines each."""
    found: dict[str, ast.stmt] = {}
    for statement in _statements(body):
        if isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            found.setdefault(statement.name, statement)
        elif isinstance(statement, (ast.Assign, ast.AnnAssign)):
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            found.update({one.id: statement for one in targets if isinstance(one, ast.Name)})
        elif (
            is_package
            and isinstance(statement, ast.ImportFrom)
            and (statement.level or "rclpy" in str(statement.module))
        ):
            found.update({one.asname or one.name: statement for one in statement.names})
    return {name: statement for name, statement in found.items() if not name.startswith("_") or name == "__init__"}


def _entry(statement: ast.stmt) -> list[str] | None:
    if not isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef)):
        return None
    is_property = any("property" in (text := ast.unparse(one)) or ".setter" in text for one in statement.decorator_list)
    return None if is_property else _parameters(statement)


def describe_source(source: Path) -> dict[str, list[str] | None]:
    """Return the names of all modules, and of the members of their classes, inherited ones too."""
    modules = {}
    for path in sorted(source.joinpath("rclpy").rglob("*.py")):
        name = ".".join(path.relative_to(source).with_suffix("").parts).removesuffix(".__init__")
        body = ast.parse(path.read_text(encoding="utf-8")).body
        modules[name] = _names(body, is_package=path.name == "__init__.py")
    classes = {
        name: statement
        for names in modules.values()
        for name, statement in names.items()
        if isinstance(statement, ast.ClassDef)
    }

    def members(cls: ast.ClassDef) -> Members:
        found: Members = {}
        for base in cls.bases:
            if (parent := classes.get(ast.unparse(base).partition("[")[0])) is not None:
                found |= members(parent)
        return found | {name: _entry(statement) for name, statement in _names(cls.body).items()}

    described: dict[str, list[str] | None] = {}
    for module, names in modules.items():
        described[module] = None
        for name, statement in names.items():
            described[f"{module}.{name}"] = _entry(statement)
            if isinstance(statement, ast.ClassDef):
                described |= {f"{module}.{name}.{one}": entry for one, entry in members(statement).items()}
    return described


def _is_new(path: str, entry: list[str] | None, jazzy: dict[str, dict[str, Any]]) -> bool:
    if path in jazzy:
        return False
    module = max((name for name in jazzy if path.startswith(f"{name}.")), key=len, default="")
    name, _, member = path.removeprefix(f"{module}.").partition(".")
    recorded: dict[str, Any] = jazzy.get(module, {}).get(name, {})
    if member:
        while "from" in recorded and "members" not in recorded and recorded["from"] in jazzy:
            recorded = jazzy[recorded["from"]].get(name, {})
        recorded = recorded.get("members", {}).get(member, {})
    if not recorded:
        return member != "__init__"
    if entry is None or recorded.get("parameters") is None:
        return False
    old = {one.partition("=")[0].strip("* ") for one in recorded["parameters"].split(", ")}
    return any(one.rstrip("=") not in old for one in entry) or any(
        one.endswith("=") and f", {one[:-1]}, " in f", {recorded['parameters']}, " for one in entry
    )


def record(source: Path) -> str:
    jazzy = json.loads(GOLDEN.joinpath("rclpy_names.json").read_text(encoding="utf-8"))
    described = describe_source(source)
    new = {path: entry for path, entry in described.items() if _is_new(path, entry, jazzy)}
    return json.dumps(new, indent=1, sort_keys=True) + "\n"


if __name__ == "__main__":
    RECORD.write_text(record(Path(sys.argv[1])), encoding="utf-8")
    print(f"wrote {RECORD}")
