"""Option ``rosidl-py run --check``: finds missing modules, names and packages that a program uses, without running it.

The syntax trees of the program and of the modules of its package and workspace are read. Names of rclpy and of message
packages are looked up in these modules, which are imported; of other packages only the presence is checked. An import
in a `try` that handles ImportError, or for type checkers, may be missing; an import in the handler is required if an
import in the `try` is missing.
"""

from __future__ import annotations

import ast
import importlib
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from rosidl_py_gen import RosidlError, found_packages
from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.base.names import RosName, did_you_mean
from rosidl_py_gen.base.package_repositories import MessagePackage
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.errors import display_path
from rosidl_py_gen.prefix import Executable, install_note


@dataclass
class _Import:
    """Imported module or name in a file of a program.

    Attributes:
        alias: name in the importing file.
        is_required: False if the program handles the absence of the module or name.
        alternatives: imports of a `try` whose handler has this import, which is required if one of them is missing.
    """

    module: str
    name: str | None
    alias: str
    line: int
    is_required: bool
    is_renamed: bool = False
    alternatives: tuple[_Import, ...] = ()


def check(program: Executable, packages: Callable[[], Mapping[str, Path]], as_json: bool) -> int:
    """Print the modules and names that a program uses and that are missing; returns 1 if there are any, else 0.

    Args:
        program: the program.
        packages: function that returns the source folders of the packages of the workspace by name.
        as_json: print JSON for programs.
    """
    sys.path[:1] = [str(program.folder)]
    modules = _OwnModules(packages)
    start = program.file
    if start is None:
        assert program.module is not None
        start = modules.file(program.module) or modules.file(f"{program.module}.__main__")
        if start is None:
            parent, _, name = program.module.rpartition(".")
            package = modules.file(parent) if parent else None
            names = [] if package is None else sorted(file.stem for file in package.parent.glob("*.py"))
            raise CommandError(f'no source of the module "{program.module}" was found{did_you_mean(name, names)}')
    findings: set[tuple[str, int, str]] = set()
    files: set[Path] = set()
    queue = [(start, program.module or "")]
    for file, module in queue:  # grows inside the loop
        if file not in files:
            files.add(file)
            queue += _FileChecker(file, module, findings, modules).run(program.function if file == start else None)
    missing = sorted(findings)
    if as_json:
        rows = [{"file": place, "line": line, "text": text} for place, line, text in missing]
        terminal_output.document({"files": len(files), "missing": rows})
    else:
        terminal_output.lines(f"{place}:{line}: {text}" for place, line, text in missing)
        terminal_output.line(f"{len(missing) or 'nothing'} missing in {pluralize(len(files), 'file')}")
    return 1 if missing else 0


class _OwnModules:
    """Source files of modules that are next to a program or in packages of its workspace.

    Returns nothing is imported to find them.
    """

    def __init__(self, packages: Callable[[], Mapping[str, Path]]) -> None:
        self._packages = packages

    def file(self, module: str) -> Path | None:
        """Return the source file of a module; None if the module is elsewhere or does not exist."""
        spec = self._spec(module)
        return None if spec is None or not (spec.origin or "").endswith(".py") else Path(str(spec.origin))

    def owner_without(self, module: str) -> Path | None:
        """Return the file of a module's top-level package if that package is in the workspace and lacks the module.

        Returns None otherwise.
        """
        top, _, below = module.partition(".")
        return self.file(top) if below and self._spec(module) is None else None

    def _spec(self, module: str) -> ModuleSpec | None:
        top, *rest = module.split(".")
        spec = PathFinder.find_spec(top, sys.path[:1])
        if spec is None or spec.origin is None:
            package = found_packages().get(top)
            folders = [] if package is None else [str(package.folder), str(package.folder / "src")]
            spec = PathFinder.find_spec(top, folders)
        if spec is None and not _is_installed(top):
            spec = self._installed_spec(top)
        for name in rest:
            if spec is None or spec.submodule_search_locations is None:
                return None
            # The name of a top-level module: a namespace package looks up its parent, which is not imported.
            spec = PathFinder.find_spec(name, [*spec.submodule_search_locations])
        return spec

    def _installed_spec(self, top: str) -> ModuleSpec | None:
        """Return the spec of a module that a package installs from a folder or package with another name, or None."""
        source = self._installed.get(top)
        if source is None:
            return None
        if source.suffix == ".py":
            return spec_from_file_location(top, source)
        return spec_from_file_location(top, source / "__init__.py", submodule_search_locations=[str(source)])

    @cached_property
    def _installed(self) -> dict[str, Path]:
        """Source files of the modules that the packages install, by their install rules; empty on Windows.

        A program finds these modules in its prefix, which Windows does not have.
        """
        if os.name == "nt":
            return {}
        # Slow to import, and rarely needed.
        from rosidl_py_gen.prefix import PackagePlan

        found: dict[str, Path] = {}
        for package, folder in self._packages().items():
            found = PackagePlan(package, folder).modules | found
        return found


class _FileChecker:
    """Checker of one file of a program, which adds missing modules and names to `findings`."""

    def __init__(self, file: Path, module: str, findings: set[tuple[str, int, str]], modules: _OwnModules) -> None:
        self._file, self._module, self._findings, self._modules = file, module, findings, modules
        self._known: dict[str, Any] = {}
        self._own_imports: list[tuple[Path, str]] = []

    def run(self, function: str | None) -> list[tuple[Path, str]]:
        """Check the file, and that it defines `function` unless None; returns imported files of the workspace."""
        try:
            tree = ast.parse(self._file.read_bytes())
        except (SyntaxError, ValueError) as error:
            self._add(getattr(error, "lineno", 0) or 0, f"cannot be read as Python: {error}")
            return []
        except (RecursionError, MemoryError) as error:
            raise CommandError(f"{self._file}: expressions are nested too deeply") from error
        package = self._module if self._file.name == "__init__.py" else self._module.rpartition(".")[0]
        imports = [*_imports(tree, package)]
        self._known = {one.alias: value for one in imports if (value := self._resolve_import(one)) is not None}
        assigned = _assigned_names(tree)
        names = assigned | {one.alias for one in imports}
        if function is not None and not names & {name := function.partition(".")[0], "*", "__getattr__"}:
            self._add(1, f"{self._module} has no {name}{did_you_mean(name, sorted(names))}; the executable calls it")
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
                self._check_attribute(node)
            elif isinstance(node, ast.ClassDef):
                self._check_class(node, assigned)
        return self._own_imports

    def _add(self, line: int, text: str) -> None:
        self._findings.add((display_path(self._file), line, text))

    def _resolve_import(self, one: _Import) -> Any:
        """Return an imported object of rclpy or a message package, else None; a missing required one is a finding."""
        top = one.module.partition(".")[0]
        if not top:
            return None
        if one.is_required and one.alternatives and not any(map(self._is_missing, one.alternatives)):
            one = replace(one, is_required=False)
        if not _is_ours(one.module):
            self._check_foreign_import(one, top)
            return None
        problem = ""
        try:
            module = _import_module(one.module)
        except ModuleNotFoundError as error:
            module, problem = None, f"{one.module}: {Extra.missing_error(error) or error}"
        if module is None:
            parent, _, name = one.module.rpartition(".")
            hint = did_you_mean(name, dir(sys.modules[parent])) if parent in sys.modules else ""
            problem = problem or f"{one.module} is not here{hint}"
        elif one.name is None:
            return module if one.is_renamed else sys.modules[top]
        elif one.name != "*":
            if _has(module, one.name) or _import_module(f"{one.module}.{one.name}") is not None:
                return getattr(module, one.name, None) or sys.modules.get(f"{one.module}.{one.name}")
            problem = _no_name_text(one.module, one.name, module)
        if problem and one.is_required:
            self._add(one.line, problem)
        return None

    def _check_foreign_import(self, one: _Import, top: str) -> None:
        if (own := self._modules.file(one.module)) is not None:
            self._own_imports.append((own, one.module))
            if one.name is not None and (submodule := self._modules.file(f"{one.module}.{one.name}")) is not None:
                self._own_imports.append((submodule, f"{one.module}.{one.name}"))
        elif one.is_required and (owner := self._modules.owner_without(one.module)) is not None:
            self._add(one.line, f"no module {one.module} in {display_path(owner.parent)}")
        elif top not in sys.stdlib_module_names and not _is_installed(top) and one.is_required:
            is_message_package = one.module.partition(".")[2].partition(".")[0] in RosName.KINDS
            hint = did_you_mean(top, found_packages()) if is_message_package else ""
            advice = "its definitions can be given with --path" if is_message_package else "it is not installed"
            note = install_note(top) or MessagePackage(top).download_note(Distribution.selected().name)
            self._add(one.line, f"no package {top}. {note}" if note else f"no package {top}{hint}; {advice}")

    def _is_missing(self, one: _Import) -> bool:
        findings: set[tuple[str, int, str]] = set()
        _FileChecker(self._file, self._module, findings, self._modules)._resolve_import(replace(one, is_required=True))
        return bool(findings)

    def _check_attribute(self, node: ast.Attribute) -> None:
        """Check that ``y`` exists in ``rclpy.x.y``, if ``rclpy.x`` is a known module, class or enumeration."""
        owner = self._resolve(node.value)
        if isinstance(owner, ModuleType) and _is_ours(owner.__name__):
            name = owner.__name__
            is_missing = not _has(owner, node.attr) and _import_module(f"{name}.{node.attr}") is None
        elif isinstance(owner, type) and _is_ours(owner.__module__):
            name = f"{owner.__module__}.{owner.__name__}"
            is_missing = not _has(owner, node.attr) and node.attr not in getattr(owner, "__annotations__", ())
            is_missing &= not hasattr(owner, "get_fields_and_field_types")  # a message
        else:
            return
        if is_missing:
            self._add(node.lineno, _no_name_text(name, node.attr, owner))

    def _resolve(self, node: ast.expr) -> Any:
        if isinstance(node, ast.Name):
            return self._known.get(node.id)
        if isinstance(node, ast.Attribute):
            owner = self._resolve(node.value)
            if isinstance(owner, ModuleType | type):
                return getattr(owner, node.attr, None)
        return None

    def _check_class(self, node: ast.ClassDef, assigned: set[str]) -> None:
        """Check that ``self.x`` exists in a class all of whose bases are of rclpy, unless the file assigns to any
        attribute ``x``.
        """
        bases = [self._resolve(base) for base in node.bases]
        if not bases or not all(isinstance(base, type) and _is_ours(base.__module__) for base in bases):
            return
        for one in ast.walk(node):
            if not isinstance(one, ast.Attribute) or not isinstance(one.value, ast.Name) or one.value.id != "self":
                continue
            if one.attr not in assigned and not any(_has(base, one.attr) for base in bases):
                self._add(one.lineno, _no_name_text(ast.unparse(node.bases[0]), one.attr, bases[0]))


def _imports(tree: ast.AST, package: str, is_required: bool = True) -> Iterator[_Import]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                name = alias.asname or alias.name.partition(".")[0]
                yield _Import(alias.name, None, name, node.lineno, is_required, alias.asname is not None)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, *([base] if base else [])])
            for alias in node.names:
                yield _Import(base, alias.name, alias.asname or alias.name, node.lineno, is_required)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            yield from _imports(ast.Module(node.orelse, []), package, is_required)
        elif isinstance(node, ast.Try):
            is_handled = any(_handles_import_error(handler.type) for handler in node.handlers)
            tried = tuple(_imports(ast.Module(node.body, []), package, is_required and not is_handled))
            yield from tried
            for handler in node.handlers:
                is_fallback = is_required and _handles_import_error(handler.type)
                for one in _imports(ast.Module(handler.body, []), package, is_fallback):
                    yield replace(one, alternatives=one.alternatives or tried)
            yield from _imports(ast.Module([*node.orelse, *node.finalbody], []), package, is_required)
        else:
            yield from _imports(node, package, is_required)


def _handles_import_error(kind: ast.expr | None) -> bool:
    text = "" if kind is None else ast.unparse(kind)
    return kind is None or any(name in text for name in ("ImportError", "ModuleNotFoundError", "Exception"))


def _is_ours(module: str) -> bool:
    """Return True for a module that rosidl-py-gen provides: of its rclpy, or of a message package."""
    from rosidl_py_gen.type_loading import RCLPY_COMPAT_DIR

    top, _, rest = module.partition(".")
    if (RCLPY_COMPAT_DIR / top / "__init__.py").is_file():
        return True
    package = found_packages().get(top)
    if package is None:
        return False
    return rest.partition(".")[0] in RosName.KINDS or not (rest or (package.folder / top / "__init__.py").is_file())


def _import_module(name: str) -> ModuleType | None:
    """Import a module, None if it does not exist. Raises ModuleNotFoundError if a module that it needs is missing."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is not None and not f"{name}.".startswith(f"{error.name}."):
            raise
        return None
    except (ImportError, RosidlError) as error:
        raise CommandError(f"{name} cannot be imported: {error}") from error


def _has(module: Any, name: str) -> bool:
    return name in dir(module) or hasattr(module, name)


def _is_installed(top: str) -> bool:
    try:
        return find_spec(top) is not None
    except (ImportError, ValueError):
        return top in sys.modules


def _no_name_text(module: str, name: str, owner: Any) -> str:
    return f"{module} has no {name}{did_you_mean(name, dir(owner))}"


def _assigned_names(tree: ast.AST) -> set[str]:
    """Return all names that a file assigns or defines, and its strings, which `setattr` may use."""
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and not isinstance(node.ctx, ast.Load):
            names.add(node.attr)
        elif isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
            names.add(node.id)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
            names.add(node.value)
    return names
