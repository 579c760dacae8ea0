"""Code rules that no linter can express; import rules are contracts in pyproject.toml (`lint-imports`)."""

from __future__ import annotations

import ast
import functools
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from counts import PAGE, is_private, is_product, listed_in_tests, listed_names, module_name, working_tree
from counts import Module as ParsedModule
from support.folders import ROOT

if TYPE_CHECKING:
    from collections.abc import Mapping

PACKAGE = ROOT / "rosidl_py_gen"
# Programs that the real rclpy runs, too; they use what is private there on purpose.
RUN_BY_RCLPY = tuple(
    f"peers/{folder}"
    for folder in ("ros_compat/programs", "ros_compat/semantics", "companions/programs", "interop_rclpy/peers")
)
# Knows private structures of Cyclone DDS; no other module reads memory by address.
KNOWS_LAYOUTS = "runtime.transport.cyclone.private_layout"
# Functions and attributes by regular expression, and the modules (with what is below them) that may use them.
RESTRICTED = {
    # Others ask the loop, or the clocks of the transport, which stand still in tests. The second half of these modules
    # is about threads, processes and files.
    r"time\.(monotonic|time|perf_counter)(_ns)?": (
        "runtime.transport.api",
        "runtime.transport.cyclone",
        "runtime.transport.zenoh",
        "runtime.logs",
        "runtime.clocks",
        "runtime.loop.loop_binding",
        "runtime.loop.event_loop",
        "base.interrupts",
        "generator_cli",
        "ros_cli.doctor.peers",
        "ros_cli.recording.writer",
        "ros_cli.bag.reading",
        "ros_cli.bag.migrate",
        "foxglove",
        "prefix.launch_files",
        "ros_cli.message_expressions",
        "ros_cli.message_text",
        "ros_cli.topic.statistics",
        "bags.writer",
        "type_loading.scan_cache",
    ),
    r".*\b(from_address|memmove|memset|PyBytes_FromStringAndSize)": (KNOWS_LAYOUTS,),
    # `yaml_text` bounds how deep and how large a document may be.
    r"yaml\.((safe_|full_|unsafe_)?load(_all)?|compose|parse|scan)": ("base.yaml_text",),
    # The structure of nodes: what stands above the runtime uses its public methods.
    r".*\.(loop_binding|participant|discovery)": ("runtime", "generator_cli", "ros_compat"),
}


def module_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def is_in(module: str, packages: tuple[str, ...]) -> bool:
    return any(module == package or module.startswith(f"{package}.") for package in packages)


class Module:
    """Names in a module; its syntax tree is not kept: together the trees take 100 MB.

    Attributes:
        used: lines and names: attributes with what they are of, imported names, and short texts for `getattr`.
        imported: packages that are imported.
        classes: names of its classes; a class for type checkers and the class in the other branch are one.
    """

    def __init__(self, text: str) -> None:
        self.used: list[tuple[int, str]] = []
        self.imported: set[str] = set()
        self.classes: list[str] = []
        of_checkers: set[ast.AST] = set()
        for node in ast.walk(ast.parse(text)):
            match node:
                case ast.Attribute(value=value, attr=name):
                    self.used.append((node.lineno, f"{value.id if isinstance(value, ast.Name) else ''}.{name}"))
                case ast.ImportFrom(module=source, names=names):
                    self.used += ((node.lineno, f"{source}.{alias.name}") for alias in names)
                    self.imported |= {(source or "").partition(".")[0]} if not node.level else set()
                case ast.Import(names=names):
                    self.imported |= {alias.name.partition(".")[0] for alias in names}
                case ast.Constant(value=str() as found) if found.isidentifier():
                    self.used.append((node.lineno, found))
                case ast.ClassDef(name=name):
                    self.classes += [name] if node not in of_checkers else []
                case ast.If(test=ast.Name(id="TYPE_CHECKING"), body=body, orelse=[_, *_]):
                    of_checkers.update(body)


@functools.cache
def tree() -> Mapping[str, str]:
    """Return the texts of all source files, and of the page that lists private names, by their paths."""
    return working_tree()


@functools.cache
def product() -> dict[str, ParsedModule]:
    """Return the modules that are written by hand, by their paths."""
    return {
        path: ParsedModule(path, text) for path, text in tree().items() if is_product(path) and path.endswith(".py")
    }


@functools.cache
def modules() -> dict[str, Module]:
    """Return all modules that are not generated."""
    paths = {module_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}
    return {
        name: Module(path.read_text(encoding="utf-8")) for name, path in paths.items() if not is_in(name, ("msgs",))
    }


def test_restricted_functions_are_used_in_permitted_modules_only() -> None:
    patterns = {re.compile(pattern): allowed for pattern, allowed in RESTRICTED.items()}
    wrong = [
        f"{name}:{line}: {used}"
        for name, module in modules().items()
        for line, used in module.used
        for pattern, allowed in patterns.items()
        if pattern.fullmatch(used) and not is_in(name, allowed)
    ]
    assert wrong == []


def test_third_party_imports_are_listed_in_import_contract() -> None:
    tomllib = pytest.importorskip("tomllib")  # of Python 3.11
    settings = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    contract = next(one for one in settings["contracts"] if one["id"] == "third-party")
    newer = {"compression"}  # of Python 3.14
    known = {
        *sys.stdlib_module_names,
        *newer,
        *contract["forbidden_modules"],
        PACKAGE.name,
        "numpy",
        "typing_extensions",
    }
    messages = {path.name for path in (PACKAGE.parent / "interfaces").iterdir()}
    of_rclpy = {*settings["root_packages"], *messages, "rosidl_parser"}
    wrong = {
        (name, package)
        for name, module in modules().items()
        for package in module.imported - (known | of_rclpy if is_in(name, ("ros_compat",)) else known)
    }
    assert wrong == set()


@pytest.mark.parametrize("stub", sorted(PACKAGE.rglob("__init__.pyi")), ids=lambda stub: stub.parent.name)
def test_every_name_of_a_stub_can_be_imported(stub: Path) -> None:
    if stub.parent.name == "tables":
        pytest.importorskip("pyarrow")
    package = import_module(".".join(stub.parent.relative_to(ROOT).parts))
    text = stub.read_text(encoding="utf-8")
    names, public = (
        [one.names[0].name for one in ast.parse(part).body if isinstance(one, ast.ImportFrom)]
        for part in (text, text.partition("# isort: split")[0])
    )
    assert names and [name for name in names if not hasattr(package, name)] == []
    assert package.__all__ == sorted(public) and set(dir(package)).issuperset(public)


def test_modules_use_private_names_of_other_modules_as_the_documentation_lists_them() -> None:
    """Private names of other packages count, too; a listed name must be in use where it is listed."""
    listed = listed_names(tree()[PAGE])
    uses = [(module_name(path), use) for path, module in product().items() for use in module.private]
    wrong = [
        f"{module}:{use.line}: {use.text}"
        for module, use in uses
        if not any(one.permits(use.name, module) for one in listed)
    ]
    unused = [one for one in listed if not any(one.permits(use.name, module) for module, use in uses)]
    assert (wrong, unused) == ([], [])


def test_classes_do_not_hide_behind_the_names_of_named_tuples() -> None:
    """The rule above permits these names for all objects."""
    wrong = {
        path: found for path, module in product().items() if (found := module.own & {"_asdict", "_make", "_replace"})
    }
    assert wrong == {}


def test_tests_use_private_names_as_the_documentation_lists_them() -> None:
    listed = listed_in_tests(tree()[PAGE])
    own_names = {name for module in product().values() for name in module.own if is_private(name)}
    unchecked = tuple(f"tests/{folder}" for folder in ("golden/", *RUN_BY_RCLPY))
    wrong, used = [], set()
    for path, text in tree().items():
        is_checked = path.startswith(("tests/", "tools/")) and path.endswith(".py") and not path.startswith(unchecked)
        if is_checked and not own_names.isdisjoint(re.findall(r"\b_\w+", text)):
            uses = [use for use in ParsedModule(path, text).private if use.name in own_names]
            wrong += [f"{path}:{use.line}: {use.text}" for use in uses if use.name not in listed]
            used |= {use.name for use in uses}
    assert (wrong, listed - used) == ([], set())


def test_no_two_classes_share_a_name() -> None:
    """Classes of `ros_compat` have rclpy's names."""
    places: dict[str, list[str]] = {}
    for name, module in modules().items():
        for one in module.classes if not is_in(name, ("ros_compat",)) else ():
            places.setdefault(one, []).append(name)
    assert len(places) > 700
    assert {one: found for one, found in places.items() if len(found) > 1} == {}
