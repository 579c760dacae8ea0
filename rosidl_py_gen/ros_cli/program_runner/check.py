"""What a program uses that is not here, found without running it: ``rosidl-py run --check``.

Its syntax tree is read, and those of the modules it imports of its own package and workspace. Names of the shim and of
message packages are looked up in these, which are ours to import; of other packages only whether they are there.
What is imported in a `try` that catches ImportError, or for type checkers, may be missing; what is imported instead may
not when it comes to that.
"""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import RosidlError, found_packages
from rosidl_py_gen.base.names import KINDS, did_you_mean
from rosidl_py_gen.errors import display_path
from rosidl_py_gen.ros_cli import ToolError, terminal_output

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.program_runner.program import Program

_MOST_BYTES = 4 << 20


@dataclass
class _Imported:
    """One import: the module, the name that is taken out of it (or none), what it is called, and whether it must be.

    One `alternatives` others must be only where one of these is missing.
    """

    module: str
    name: str | None
    alias: str | None
    line: int
    is_required: bool
    is_renamed: bool = False
    alternatives: tuple[_Imported, ...] = ()


@dataclass
class _Findings:
    """What was found: by place, so that all is told once and in order."""

    lines: dict[tuple[str, int, str], None] = field(default_factory=dict)
    modules: set[Path] = field(default_factory=set)

    def add(self, file: Path, line: int, text: str) -> None:
        self.lines.setdefault((display_path(file), line, text))


def check(program: Program, as_json: bool) -> int:
    """Print what the program lacks; 1 when that is anything."""
    sys.path[:1] = [program.folder]
    start = program.file
    if start is None:
        assert program.module is not None
        start = _own_file(program.module) or _own_file(f"{program.module}.__main__")
        if start is None:
            raise ToolError(_no_source(program.module))
    findings = _Findings()
    waiting = [(start, program.module or "")]
    while waiting:
        file, name = waiting.pop(0)
        if file not in findings.modules:
            findings.modules.add(file)
            waiting += _checked(file, name, findings, program.function if file == start else None)
    if as_json:
        missing = [{"file": place, "line": line, "text": text} for place, line, text in sorted(findings.lines)]
        terminal_output.document({"files": len(findings.modules), "missing": missing})
        return 1 if missing else 0
    terminal_output.lines(f"{place}:{line}: {text}" for place, line, text in sorted(findings.lines))
    count, files = len(findings.lines), len(findings.modules)
    of = f"in {files} file{'s' if files != 1 else ''}"
    terminal_output.line(f"{count or 'nothing'} missing {of}")
    return 1 if findings.lines else 0


def _checked(file: Path, name: str, findings: _Findings, function: str | None) -> list[tuple[Path, str]]:
    """Check one file, and whether it has a function; the files of the program's own that it imports."""
    try:
        data = file.read_bytes()
        if len(data) > _MOST_BYTES:
            raise ToolError(f"{file} is longer than {_MOST_BYTES} bytes")
        tree = ast.parse(data)
    except (SyntaxError, ValueError) as error:
        findings.add(file, getattr(error, "lineno", 0) or 0, f"cannot be read as Python: {error}")
        return []
    except (RecursionError, MemoryError) as error:
        raise ToolError(f"{file}: expressions are nested too deeply") from error
    package = name if file.name == "__init__.py" else name.rpartition(".")[0]
    known: dict[str, Any] = {}
    more: list[tuple[Path, str]] = []
    for one in _imports(tree, package):
        found = _resolve_import(one, file, findings, more)
        if one.alias is not None and found is not None:
            known[one.alias] = found
    if function is not None:
        _check_function(function.partition(".")[0], name, tree, file, findings)
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
            _check_attribute(node, known, file, findings)
        elif isinstance(node, ast.ClassDef):
            _check_class(node, known, tree, file, findings)
    return more


# --- imports ----------------------------------------------------------------------------------------------------------


def _imports(tree: ast.AST, package: str, must: bool = True) -> Iterator[_Imported]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                called = alias.asname or alias.name.partition(".")[0]
                yield _Imported(alias.name, None, called, node.lineno, must, alias.asname is not None)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, *([base] if base else [])])
            for alias in node.names:
                yield _Imported(base, alias.name, alias.asname or alias.name, node.lineno, must)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            for part in node.orelse:
                yield from _imports(ast.Module([part], []), package, must)
        elif isinstance(node, ast.Try):
            caught = any(_catches_import_error(handler.type) for handler in node.handlers)
            tried = tuple(_imports(ast.Module(node.body, []), package, must and not caught))
            yield from tried
            for handler in node.handlers:
                is_next = must and _catches_import_error(handler.type)
                for one in _imports(ast.Module(handler.body, []), package, is_next):
                    yield replace(one, alternatives=one.alternatives or tried)
            yield from _imports(ast.Module([*node.orelse, *node.finalbody], []), package, must)
        else:
            yield from _imports(node, package, must)


def _catches_import_error(kind: ast.expr | None) -> bool:
    text = "" if kind is None else ast.unparse(kind)
    return kind is None or any(name in text for name in ("ImportError", "ModuleNotFoundError", "Exception"))


def _resolve_import(one: _Imported, file: Path, findings: _Findings, more: list[tuple[Path, str]]) -> Any:
    """The module or object that an import brings if it is of ours; the program's own files go into `more`."""
    top = one.module.partition(".")[0]
    if not top:
        return None
    if one.is_required and one.alternatives and not any(_is_missing(other, file) for other in one.alternatives):
        one = replace(one, is_required=False)
    if not _is_ours(one.module):
        own = _own_file(one.module)
        if own is not None:
            more.append((own, one.module))
            if one.name is not None and (inside := _own_file(f"{one.module}.{one.name}")) is not None:
                more.append((inside, f"{one.module}.{one.name}"))
        elif top not in sys.stdlib_module_names and not _is_there(top) and one.is_required:
            findings.add(file, one.line, _no_package(top, one.module))
        return None
    module = _module(one.module)
    if module is None:
        if one.is_required:
            findings.add(file, one.line, f"{one.module} is not here{_nearest(one.module)}")
        return None
    if one.name is None:
        return module if one.is_renamed else sys.modules[top]
    if one.name == "*":
        return None
    if not _has(module, one.name) and _module(f"{one.module}.{one.name}") is None:
        if one.is_required:
            findings.add(file, one.line, _no_name(one.module, one.name, module))
        return None
    return getattr(module, one.name, None) or sys.modules.get(f"{one.module}.{one.name}")


def _is_missing(one: _Imported, file: Path) -> bool:
    findings = _Findings()
    _resolve_import(replace(one, is_required=True), file, findings, [])
    return bool(findings.lines)


def _is_ours(module: str) -> bool:
    """Whether it is of the shim, or of messages."""
    from rosidl_py_gen.type_loading.import_hook import RCLPY_COMPAT_DIR

    top, _, rest = module.partition(".")
    if (RCLPY_COMPAT_DIR / top / "__init__.py").is_file():
        return True
    found = found_packages().get(top)
    return found is not None and (rest.partition(".")[0] in KINDS or (not rest and not _has_modules(found.folder, top)))


def _has_modules(folder: Path, package: str) -> bool:
    return (folder / package / "__init__.py").is_file()


def _module(name: str) -> ModuleType | None:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError:
        return None
    except (ImportError, RosidlError) as error:
        raise ToolError(f"{name} cannot be imported: {error}") from error


def _has(module: Any, name: str) -> bool:
    return name in dir(module) or hasattr(module, name)


def _own_file(module: str) -> Path | None:
    """The source of a module of the program: beside the script, or in the workspace; nothing is imported."""
    top, *rest = module.split(".")
    found = PathFinder.find_spec(top, sys.path[:1])
    if found is None or found.origin is None:
        folder = found_packages().get(top)
        places = [] if folder is None else [str(folder.folder), str(folder.folder / "src")]
        found = PathFinder.find_spec(top, places)
    for name in rest:
        if found is None or found.submodule_search_locations is None:
            return None
        found = PathFinder.find_spec(f"{found.name}.{name}", [*found.submodule_search_locations])
    if found is None or found.origin is None or not found.origin.endswith(".py"):
        return None
    return Path(found.origin)


def _no_source(module: str) -> str:
    """That a module is not found, and which one of its package is called nearly so."""
    above, _, name = module.rpartition(".")
    beside = _own_file(above) if above else None
    files = [] if beside is None or beside.name != "__init__.py" else sorted(beside.parent.glob("*.py"))
    return f'no source of the module "{module}" is found{did_you_mean(name, [file.stem for file in files])}'


def _is_there(top: str) -> bool:
    try:
        return find_spec(top) is not None
    except (ImportError, ValueError):
        return top in sys.modules


def _no_package(top: str, module: str) -> str:
    is_of_messages = module.partition(".")[2].partition(".")[0] in KINDS
    help_ = "its definitions can be given with --path" if is_of_messages else "it is not installed"
    return f"no package {top}{did_you_mean(top, found_packages()) if is_of_messages else ''}; {help_}"


def _nearest(module: str) -> str:
    parent, _, name = module.rpartition(".")
    found = sys.modules.get(parent)
    return did_you_mean(name, dir(found)) if found is not None else ""


def _no_name(module: str, name: str, found: Any) -> str:
    return f"{module} has no {name}{did_you_mean(name, dir(found))}"


# --- names ------------------------------------------------------------------------------------------------------------


def _check_attribute(node: ast.Attribute, known: dict[str, Any], file: Path, findings: _Findings) -> None:
    """``rclpy.x.y`` where `rclpy` is what was imported: modules, classes and enumerations are looked into."""
    owner = _resolved(node.value, known)
    if isinstance(owner, ModuleType) and _is_ours(owner.__name__):
        name = owner.__name__
        is_missing = not _has(owner, node.attr) and _module(f"{name}.{node.attr}") is None
    elif isinstance(owner, type) and _is_ours(owner.__module__):
        name = f"{owner.__module__}.{owner.__name__}"
        is_missing = not _has(owner, node.attr) and not _is_field(owner, node.attr)
    else:
        return
    if is_missing:
        findings.add(file, node.lineno, _no_name(name, node.attr, owner))


def _is_field(owner: type, name: str) -> bool:
    return hasattr(owner, "get_fields_and_field_types") or name in getattr(owner, "__annotations__", ())


def _resolved(node: ast.expr, known: dict[str, Any]) -> Any:
    if isinstance(node, ast.Name):
        return known.get(node.id)
    if isinstance(node, ast.Attribute):
        owner = _resolved(node.value, known)
        if isinstance(owner, ModuleType | type):
            return getattr(owner, node.attr, None)
    return None


def _check_class(node: ast.ClassDef, known: dict[str, Any], tree: ast.AST, file: Path, findings: _Findings) -> None:
    """``self.x`` in a class made of classes of the shim alone, where nothing in the file is called x."""
    bases = [_resolved(base, known) for base in node.bases]
    if not bases or not all(isinstance(base, type) and _is_ours(base.__module__) for base in bases):
        return
    given = _assigned_names(tree)
    for one in ast.walk(node):
        if not isinstance(one, ast.Attribute) or not isinstance(one.value, ast.Name) or one.value.id != "self":
            continue
        if one.attr not in given and not any(_has(base, one.attr) for base in bases):
            findings.add(file, one.lineno, _no_name(ast.unparse(node.bases[0]), one.attr, bases[0]))


def _check_function(function: str, name: str, tree: ast.Module, file: Path, findings: _Findings) -> None:
    """What a console script calls, unless anything in its module or imported there may be called so."""
    imported = {one.alias or one.name for one in _imports(tree, name)}
    given = _assigned_names(tree) | {alias for alias in imported if alias is not None}
    if function not in given and "*" not in given and "__getattr__" not in given:
        nearest = did_you_mean(function, sorted(given))
        findings.add(file, 1, f"{name} has no {function}{nearest}; the executable calls it")


def _assigned_names(tree: ast.AST) -> set[str]:
    """All that something in a file is called; names that `setattr` gets cannot be known."""
    given: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and not isinstance(node.ctx, ast.Load):
            given.add(node.attr)
        elif isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
            given.add(node.id)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            given.add(node.name)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
            given.add(node.value)
    return given
