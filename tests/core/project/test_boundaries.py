"""Code rules that no linter can express; import rules are contracts in pyproject.toml (`lint-imports`)."""

from __future__ import annotations

import ast
import functools
import re
import sys
from importlib import import_module
from pathlib import Path

import pytest
from support.folders import ROOT

PACKAGE = ROOT / "rosidl_py_gen"
# Names with an underscore that other modules may use: what generated classes have for the code that calls them,
# what is public in every named tuple, what bags have for tables, and subscriptions for transform buffers.
SHARED = {
    "_deliver_without_loop",
    "_source",
    "_cuts",
    "_replace",
    "_TYPE",
    "_decode",
    "_encode",
    "_encode_into",
    "_get_plain",
    "_set_plain",
    "_FIELDS",
}
# The same for modules of the runtime only: what nodes and contexts are made of, which users do not see.
SHARED_IN_RUNTIME = {
    "_refreshed_graph",
    "_start_rosout",
    "_shared_loop",
    "_scope",
    "_core",
    "_end_wait",
    "_record",
    "_start_request",
    "_abandon_request",
    "_available",
    "_servers",
    "_publish_without_waiting",
    "_deliver",
    "_push",
    "_has_news",
    "_of_node",
    "_set_definition",
    "_schedule",
    "_why_missing",
    "_on_any_jump",
    "_why_unmatched",
}
# The same for bags: what readers and writers have for copies, which keep every record, and users do not see.
SHARED_IN_BAGS = {
    "_inherit",
    "_omitted",
    "_statistics",
    "_add_schema",
    "_copy_metadata",
    "_copy_attachment",
}
# The same for the shim: names of rclpy that its own modules share. Our names for other modules begin with `rosidl_`.
SHARED_IN_SHIM = {
    "_executor_event",
    "_set_executor",
    "_set_ros_time_is_active",
    "_timer",
    "_TYPE_SUPPORT",
}
# Functions of the standard library that are public in spite of their names.
# The last two are in asyncio.__all__, for those who write event loops.
DOCUMENTED = {
    "sys._current_frames",
    "sys._getframe",
    "os._exit",
    "asyncio._get_running_loop",
    "asyncio._set_running_loop",
}
NAMED_TUPLES = {"_replace", "_fields"}
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
        own: functions, classes, variables, and attributes of `self` that the module defines.
        private: lines, names and texts of attributes with an underscore, except attributes of `self` and `cls`.
        private_texts: lines and private names that are imported, or given to `setattr` and the like.
        classes: names of its classes; a class for type checkers and the class in the other branch are one.
    """

    def __init__(self, text: str) -> None:
        self.used: list[tuple[int, str]] = []
        self.imported: set[str] = set()
        self.own: set[str] = set()
        self.private: list[tuple[int, str, str]] = []
        self.private_texts: list[tuple[int, str]] = []
        self.classes: list[str] = []
        of_checkers: set[ast.AST] = set()
        for node in ast.walk(ast.parse(text)):
            match node:
                case ast.Attribute(value=value, attr=name):
                    self.used.append((node.lineno, f"{value.id if isinstance(value, ast.Name) else ''}.{name}"))
                    if not _is_own(value):
                        if _is_private(name):
                            self.private.append((node.lineno, name, ast.unparse(node)))
                    elif isinstance(node.ctx, ast.Store):
                        self.own.add(name)
                case ast.ImportFrom(module=source, names=names):
                    self.used += ((node.lineno, f"{source}.{alias.name}") for alias in names)
                    self.imported |= {(source or "").partition(".")[0]} if not node.level else set()
                    self._add_private_texts(node.lineno, [alias.name for alias in names])
                case ast.Import(names=names):
                    self.imported |= {alias.name.partition(".")[0] for alias in names}
                case ast.Constant(value=str() as found) if found.isidentifier():
                    self.used.append((node.lineno, found))
                case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                    self.own.add(name)
                case ast.ClassDef(name=name):
                    self.own.add(name)
                    self.classes += [name] if node not in of_checkers else []
                case ast.AnnAssign(target=ast.Name(id=name)):
                    self.own.add(name)
                case ast.Assign(targets=targets):
                    self.own |= {target.id for target in targets if isinstance(target, ast.Name)}
                case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if re.search(
                    "(set|get|has|del)attr$", name
                ):
                    texts = (one.value for one in node.args[:2] if isinstance(one, ast.Constant))
                    self._add_private_texts(node.lineno, [*map(str, texts)])
                case ast.If(test=ast.Name(id="TYPE_CHECKING"), body=body, orelse=[_, *_]):
                    of_checkers.update(body)

    def _add_private_texts(self, line: int, texts: list[str]) -> None:
        names = (text.rpartition(".")[2] for text in texts)
        self.private_texts += ((line, name) for name in names if _is_private(name))

    def private_uses(self, shared: set[str] = SHARED) -> list[tuple[int, str, str]]:
        """Return the elements of `private` that nothing in this file is called, and that are not `shared`."""
        known = shared | self.own
        return [one for one in self.private if one[1] not in known and one[2] not in DOCUMENTED]


def _is_private(name: str) -> bool:
    return name.startswith("_") and not name.endswith("__") and name != "_asdict"  # public in named tuples


def _is_own(node: ast.AST) -> bool:
    return isinstance(node, ast.Name) and node.id in ("self", "cls")


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


def test_modules_do_not_use_private_names_of_other_modules() -> None:
    more = {"runtime": SHARED_IN_RUNTIME, "bags": SHARED_IN_BAGS, "ros_compat": SHARED_IN_SHIM}
    wrong = [
        f"{name}:{line}: {text}"
        for name, module in modules().items()
        if name != KNOWS_LAYOUTS
        for line, _, text in module.private_uses(SHARED | more.get(name.partition(".")[0], set()))
    ]
    assert wrong == []


def test_tests_use_private_names_only_if_the_documentation_lists_them() -> None:
    tests = ROOT / "tests"
    text = (PACKAGE.parent / "docs/internals/architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"(?m)^\|([^|]+)", text.partition("## Private structure that tests use")[2])
    listed = {name for row in rows for name in re.findall(r"`(_\w+)`", row)}
    own_names = {name for module in modules().values() for name in module.own if _is_private(name)}
    unchecked = tuple(f"{tests.as_posix()}/{folder}" for folder in ("golden/", *RUN_BY_RCLPY))
    wrong = []
    for path in sorted([*tests.rglob("*.py"), *ROOT.glob("tools/*.py")]):
        text = path.read_text(encoding="utf-8")
        is_checked = not path.as_posix().startswith(unchecked)
        if is_checked and not {*re.findall(r"\b_\w+", text)}.isdisjoint(own_names - listed):
            module = Module(text)
            used = [(line, name) for line, name, _ in module.private_uses(NAMED_TUPLES)]
            used += [(line, name) for line, name in module.private_texts if name not in module.own]
            wrong += [f"{path.relative_to(ROOT)}:{line}: {name}" for line, name in used if name in own_names - listed]
    assert listed and wrong == []


def test_no_two_classes_share_a_name() -> None:
    """Classes of `ros_compat` have rclpy's names."""
    places: dict[str, list[str]] = {}
    for name, module in modules().items():
        for one in module.classes if not is_in(name, ("ros_compat",)) else ():
            places.setdefault(one, []).append(name)
    assert len(places) > 700
    assert {one: found for one, found in places.items() if len(found) > 1} == {}
