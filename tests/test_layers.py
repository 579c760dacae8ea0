"""The import rules of the package, as data. Imports inside functions count.

Imports for type checkers may point up.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "rosidl_py_gen"
NAME = PACKAGE.name

# The parts, lowest first. A module may import its own part and those named here; nothing else of ours.
# `support` is what generated code needs; `base` needs nothing.
PARTS: dict[str, tuple[str, ...]] = {
    "base": (),
    "support": ("base",),
    "spec": ("base", "support"),
    "codegen": ("base", "support", "spec"),
    "msgs": ("base", "support"),
    "compiler": ("base", "support", "spec", "codegen"),
    "runtime": ("base", "support", "msgs", "types", "top"),
    "types": ("base", "support", "spec", "codegen", "compiler"),
    "distribution": ("base", "spec", "compiler", "top"),
    "cli": (
        "base",
        "support",
        "spec",
        "codegen",
        "compiler",
        "types",
        "runtime",
        "msgs",
        "top",
        "distribution",
        "bags",
    ),
    "numpy": ("base", "support", "types", "top"),
    "sync": ("base", "support", "types", "top", "runtime"),
    "tf": ("base", "support", "types", "top", "numpy", "runtime", "sync"),
    "bags": ("base", "support", "types", "top", "runtime"),
    "tables": ("base", "support", "types", "top", "bags"),
    "tools": (
        "base",
        "support",
        "spec",
        "compiler",
        "types",
        "runtime",
        "msgs",
        "top",
        "cli",
        "bags",
        "tables",
        "tf",
        "numpy",
    ),
    "top": ("base", "support", "types"),
    "shim": ("base", "top", "runtime", "tf", "sync", "numpy"),
}
# What has a method for something that stands above it, and loads that when the method is called.
OFFERED = {("bags.reader", "tables.reading"), ("bags.writer", "tables.writing")}
# Which part a module belongs to: the longest prefix counts.
OWNERS = {
    "": "top",
    "errors": "base",
    "base": "base",
    "cdr": "support",
    "compiler": "compiler",
    "compiler.spec": "spec",
    "compiler.codegen": "codegen",
    "distribution": "distribution",
    "types": "types",
    "msgs": "msgs",
    "runtime": "runtime",
    "cli": "cli",
    "numpy": "numpy",
    "sync": "sync",
    "tf": "tf",
    "bags": "bags",
    "mcap": "bags",
    "tables": "tables",
    "tools": "tools",
    "rclpy": "shim",
    "__main__": "cli",
}
# The rooms of the runtime, and which others each may import. "" are the files above all rooms.
_LOW = ("names", "time", "logs", "transport", "loop", "graph", "endpoints")
ROOMS: dict[str, tuple[str, ...]] = {
    "names": (),
    "time": ("logs",),
    "logs": ("names",),
    "transport": ("names", "logs"),
    "loop": ("time", "logs", "transport"),
    "graph": ("names", "logs", "transport", "loop"),
    "endpoints": ("names", "time", "logs", "transport", "loop", "graph"),
    "parameters": _LOW,
    "actions": _LOW,
    "types": (*_LOW, "parameters"),
    "node": (*_LOW, "parameters", "actions", "types"),
    "lifecycle": (*_LOW, "node"),
    "": (*_LOW, "parameters", "actions", "types", "node", "lifecycle"),
}
# These use what the runtime shows to everybody: `rosidl_py_gen.runtime` and `rosidl_py_gen.runtime.qos`.
ABOVE_THE_RUNTIME = ("numpy", "sync", "tf", "bags", "tables", "tools")
MOST_MODULES = 20
# What each folder of the command line may import of the others; all may import what lies beside the folders.
TOOLS: dict[str, tuple[str, ...]] = {
    "commands": (),
    "topic": ("commands",),
    "doctor": (),
    "graph": (),
    "service": ("commands",),
    "bag": ("commands",),
    "recording": ("commands", "bag"),
    "playback": ("commands", "bag"),
    "foxglove": ("commands",),
    "action": (),
    "node": (),
    "param": (),
    "lifecycle": (),
    "tf": ("commands",),
    "log": ("commands",),
    "run": (),
}
# Names with an underscore that other modules may use: what generated classes have for the code that calls them,
# what is public in every named tuple, and what bags have for tables.
SHARED = {
    "_source",
    "_cuts",
    "_replace",
    "_TYPE",
    "_decode",
    "_encode",
    "_encode_into",
    "_native",
    "_assign",
    "_FIELDS",
}
# The same for modules of the runtime only: what nodes and contexts are made of, which users do not see.
SHARED_IN_RUNTIME = {
    "_scope",
    "_core",
    "_end_wait",
    "_record",
    "_ask",
    "_forget",
    "_servers",
    "_publish_without_waiting",
    "_deliver",
    "_push",
    "_has_news",
    "_schedule",
    "_why_missing",
    "_on_every_jump",
    "_why_unmatched",
}
# The same for the shim: what entities have for executors, where every public name would be one of rclpy's.
SHARED_IN_SHIM = {
    "_executor_event",
    "_rosidl_from_runtime",
    "_goal_info",
    "_rosidl_handed_out",
    "_rosidl_is_ready",
    "_rosidl_queue",
    "_rosidl_what_is_served",
    "_pending",
    "_rosidl_publish_feedback",
    "_rosidl_publish_status",
    "_rosidl_queues",
    "_set_executor",
    "_set_ros_time_is_active",
    "_rosidl_take",
    "_timer",
    "_rosidl_watch",
    "_TYPE_SUPPORT",
    "_update_state",
}
# Functions of the standard library that are public in spite of their names.
# The last two are in asyncio.__all__, for those who write event loops.
DOCUMENTED = {"sys._getframe", "os._exit", "asyncio._get_running_loop", "asyncio._set_running_loop"}
# Knows private structures of Cyclone DDS, and says so; nobody else looks behind an address.
KNOWS_LAYOUTS = "runtime.transport.cyclone.structures"
# Each foreign thing has one seam: distribution -> modules that may import it.
SEAMS = {
    "lark": ("compiler.spec.parse",),
    "jinja2": ("compiler.codegen.render",),
    "click": ("cli", "tools"),
    "rich": ("tools",),
    "zenoh": ("runtime.transport.zenoh",),
    "xxhash": ("runtime.transport.zenoh.tokens",),
    # All but the first only write, or name classes of nodes: `test_one_module_reads_yaml`.
    "tomli": ("base.project",),
    "yaml": (
        "base.yaml_text",
        "rclpy",
        "runtime.parameters.files",
        "tools.messages",
        "tools.bag.yaml_tree",
        "bags.metadata",
    ),
    "mcap": ("bags",),
    "zstandard": ("bags.files.chunks", "bags.files.compressed", "bags.parts"),
    "lz4": ("bags.files.chunks",),
    "websockets": ("tools.foxglove.server", "tools.foxglove.viewer"),
    "pyarrow": ("tables.arrow",),
    "duckdb": ("tables.query",),
    "fsspec": ("tables.places",),
    "upath": ("bags.remote",),
    "distributed": ("tables.many.cluster",),
    "PIL": ("tools.tf.png", "numpy.compressed"),
    "pytest": ("runtime.pytest_plugin",),
    "transforms3d": ("rclpy",),
    "flit_core": ("distribution.build",),
}
# Who may ask the machine what time it is; everybody else asks the loop, or the clocks of the transport, which stand
# still in tests. The second half is about what takes place outside of the loop: other threads, processes, files.
KNOW_THE_TIME = (
    "runtime.transport.clocks",
    "runtime.transport.cyclone",
    "runtime.transport.zenoh",
    "runtime.logs",
    "runtime.time.clock",
    "runtime.loop.portal",
    "runtime.loop.virtual_time",
    "base.interrupts",
    "tools.doctor.peers",
    "tools.recording.writer",
    "tools.bag.convert",
    "tools.bag.migrate",
    "tools.foxglove",
    "tools.filters",
    "tools.messages",
    "tools.topic.figures",
    "bags.writer",
    "cli.generate",
)
# Only these may import the node: everything else gets a transport and a resolved name.
NODE_USERS = ("runtime", "runtime.lifecycle.node", "runtime.pytest_plugin", "cli")
# Never, not even for type checkers.
APART = [("spec", "runtime"), ("codegen", "runtime"), ("runtime", "spec"), ("runtime", "codegen")]
# Generated code needs the middle and numpy, nothing else.
GENERATED_MAY_IMPORT = {"__future__", "builtins", "dataclasses", "struct", "typing", "numpy", NAME}
# A folder of packages that have no part in `rosidl_py_gen`: `rclpy` and its companions, made importable by the hook.
SHIM = "rclpy"
SHIM_PACKAGES = {path.name for path in (PACKAGE / SHIM).iterdir() if (path / "__init__.py").is_file()}
# All of ours that they may import, for type checkers, too.
FOR_THE_SHIM = (
    "",
    "runtime",
    "runtime.qos",
    "runtime._rclpy_support",
    "tf",
    "sync",
    "numpy",
    "base.resources",
    "base.yaml_text",
)


@dataclass(frozen=True)
class Import:
    module: str  # what is imported, dotted
    line: int
    for_typing: bool


@cache
def tree_of(path: Path) -> ast.Module:
    """Parsed once: many tests look at every file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def module_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def part_of(module: str) -> str:
    while module and module not in OWNERS:
        module = module.rpartition(".")[0]
    return OWNERS[module]


def imports_of(path: Path) -> list[Import]:
    tree = tree_of(path)
    return list(_walk(tree, path, False))


def _statements(node: ast.AST) -> Iterator[ast.AST]:
    """What is directly inside; no expression, where nothing can be imported."""
    for name in ("body", "handlers", "cases", "orelse", "finalbody"):
        yield from getattr(node, name, ())


def _walk(node: ast.AST, path: Path, for_typing: bool) -> Iterator[Import]:
    for child in _statements(node):
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test):
            inside = not isinstance(child.test, ast.UnaryOp)
            for part, typed in ((child.body, inside), (child.orelse, not inside)):
                for statement in part:
                    yield from _imports(statement, path, for_typing or typed)
                    yield from _walk(statement, path, for_typing or typed)
            continue
        yield from _imports(child, path, for_typing)
        yield from _walk(child, path, for_typing)


def _imports(node: ast.AST, path: Path, for_typing: bool) -> Iterator[Import]:
    if isinstance(node, ast.Import):
        for alias in node.names:
            yield Import(alias.name, node.lineno, for_typing)
    elif isinstance(node, ast.ImportFrom):
        base = node.module or ""
        if node.level:
            package = path.relative_to(PACKAGE.parent).parent.parts
            base = ".".join([*package[: len(package) - node.level + 1], *([base] if base else [])])
        modules = [f"{base}.{alias.name}" for alias in node.names if _is_module(f"{base}.{alias.name}")]
        for module in modules:
            yield Import(module, node.lineno, for_typing)
        if len(modules) < len(node.names):  # names out of the module itself
            yield Import(base, node.lineno, for_typing)


def _is_module(name: str) -> bool:
    where = PACKAGE.parent.joinpath(*name.split("."))
    return where.with_suffix(".py").is_file() or (where / "__init__.py").is_file()


FILES = sorted(PACKAGE.rglob("*.py"))
WRITTEN = [path for path in FILES if part_of(module_of(path)) != "msgs" or path == PACKAGE / "msgs" / "__init__.py"]


@cache
def all_imports() -> dict[Path, list[Import]]:
    """Of all files, read by the first test that asks."""
    return {path: imports_of(path) for path in FILES}


@pytest.fixture(scope="module", autouse=True)
def _forgotten() -> Iterator[None]:
    """The trees of all files are a million objects, through which every later garbage collection would look."""
    yield
    tree_of.cache_clear()


def ours(one: Import) -> str | None:
    """The module of this package that is imported, without the package's own name."""
    if one.module == NAME:
        return ""
    return one.module.removeprefix(NAME + ".") if one.module.startswith(NAME + ".") else None


def where(path: Path, one: Import) -> str:
    return f"{path.relative_to(PACKAGE.parent)}:{one.line}: imports {one.module}"


def test_the_rules_cover_every_module_and_name_only_what_exists() -> None:
    assert len(FILES) > 80
    for name in OWNERS:
        assert name in ("", "__main__", SHIM) or _is_module(f"{NAME}.{name}"), f"{name} is not a module"
    assert {part for uses in PARTS.values() for part in uses} <= set(PARTS)


def test_imports_point_down() -> None:
    wrong = []
    for path, imports in all_imports().items():
        own = part_of(module_of(path))
        for one in imports:
            target = ours(one)
            if target is None or one.for_typing or not _is_module(f"{NAME}.{target}".rstrip(".")):
                continue
            if (module_of(path), target) in OFFERED:
                continue
            # `from rosidl_py_gen import __version__` reads a name of the package, which imports nothing by itself.
            part = part_of(target)
            if part not in (own, *PARTS[own]) and not (target == "" and own in ("cli", "tools")):
                wrong.append(where(path, one))
    assert wrong == []


def test_compiler_and_runtime_never_meet() -> None:
    wrong = [
        where(path, one)
        for path, imports in all_imports().items()
        for one in imports
        for left, right in APART
        if part_of(module_of(path)) == left and (target := ours(one)) is not None and part_of(target) == right
    ]
    assert wrong == []


def test_every_foreign_package_has_its_seam() -> None:
    wrong = [
        where(path, one)
        for path, imports in all_imports().items()
        for one in imports
        for foreign, seams in SEAMS.items()
        if one.module.split(".")[0] == foreign and not _allowed(module_of(path), foreign, seams)
    ]
    assert wrong == []


def test_one_module_reads_yaml() -> None:
    readers = {"load", "load_all", "safe_load", "safe_load_all", "full_load", "unsafe_load", "compose", "parse", "scan"}
    found = {
        module_of(path)
        for path in WRITTEN
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.Attribute) and node.attr in readers and ast.unparse(node.value) == "yaml"
    }
    assert found == {"base.yaml_text"}


def _allowed(module: str, foreign: str, seams: tuple[str, ...]) -> bool:
    return any(module == seam or module.startswith(seam + ".") for seam in seams)


def test_every_foreign_import_is_a_declared_dependency() -> None:
    known = {*sys.stdlib_module_names, *SEAMS, "numpy", "typing_extensions", NAME}
    interfaces = {path.name for path in (PACKAGE.parent / "interfaces").iterdir()}
    wrong = [
        where(path, one)
        for path, imports in all_imports().items()
        for one in imports
        if not (
            part_of(module_of(path)) == "shim"
            and one.module.split(".")[0] in {*SHIM_PACKAGES, *interfaces, "rosidl_parser"}
        )
        if (top := one.module.split(".")[0]) not in known or (top == "typing_extensions" and not one.for_typing)
    ]
    assert wrong == []


def test_what_stands_above_the_runtime_uses_its_public_names() -> None:
    wrong = [
        where(path, one)
        for path, imports in all_imports().items()
        for one in imports
        if part_of(module_of(path)) in ABOVE_THE_RUNTIME
        and one.module.startswith(f"{NAME}.runtime.")
        and one.module != f"{NAME}.runtime.qos"
    ]
    assert wrong == []


def test_the_shim_imports_public_names() -> None:
    wrong = [
        where(path, one)
        for path, imports in all_imports().items()
        for one in imports
        if part_of(module_of(path)) == "shim" and (target := ours(one)) is not None and target not in FOR_THE_SHIM
    ]
    assert wrong == []


def test_packages_of_the_shim_form_no_circle() -> None:
    modules = {module_of(path).removeprefix(f"{SHIM}."): path for path in FILES if part_of(module_of(path)) == "shim"}
    edges = {
        name: {one.module for one in all_imports()[path] if one.module in modules and not one.for_typing} - {name}
        for name, path in modules.items()
    }
    assert edges and circles(edges) == []


@pytest.mark.parametrize("path", WRITTEN, ids=module_of)
def test_what_stands_above_the_runtime_reaches_through_nothing(path: Path) -> None:
    if part_of(module_of(path)) not in ABOVE_THE_RUNTIME:
        return
    tree = tree_of(path)
    wrong = [
        f"line {node.lineno}: .{node.attr}"
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and node.attr in {"_scope", "_core", "bridge", "participant", "discovery"}
    ]
    assert wrong == []


def test_nothing_imports_the_node() -> None:
    wrong = [
        where(path, one)
        for path, imports in all_imports().items()
        for one in imports
        if one.module == f"{NAME}.runtime.node.node"
        and module_of(path) not in NODE_USERS
        and part_of(module_of(path)) not in NODE_USERS[-1:]
        and not one.for_typing
    ]
    assert wrong == []


RUNTIME = [path for path in FILES if path.is_relative_to(PACKAGE / "runtime")]


def room_of(module: str) -> str:
    """Of a module of the runtime."""
    room = module.removeprefix("runtime").lstrip(".").split(".")[0]
    return room if room in ROOMS else ""


def test_rooms_import_rooms_below_them() -> None:
    wrong = []
    for path in RUNTIME:
        own = room_of(module_of(path))
        for one in all_imports()[path]:
            target = ours(one)
            if target is None or target.split(".")[0] != "runtime" or one.for_typing:
                continue
            if room_of(target) not in (own, *ROOMS[own]):
                wrong.append(where(path, one))
    assert wrong == []


def test_every_folder_of_the_runtime_is_a_room_that_can_be_surveyed() -> None:
    folders = {path.parent.relative_to(PACKAGE / "runtime").parts for path in RUNTIME}
    assert {parts[0] if parts else "" for parts in folders} == set(ROOMS)
    for parts in folders:
        assert len(list(PACKAGE.joinpath("runtime", *parts).glob("*.py"))) <= MOST_MODULES, parts


def test_every_other_folder_can_be_surveyed() -> None:
    modules = [path for path in PACKAGE.rglob("*.py") if path.name != "__init__.py"]
    given = {"msgs", SHIM}  # generated; and the modules that rclpy has
    counts = Counter(path.parent for path in modules if given.isdisjoint(path.relative_to(PACKAGE).parts))
    assert {folder: count for folder, count in counts.items() if count > MOST_MODULES} == {}


def test_the_folders_of_the_command_line_import_those_below_them() -> None:
    tools = PACKAGE / "tools"
    assert {path.parent.name for path in tools.rglob("*.py")} == {"tools", *TOOLS}
    wrong = []
    for path in tools.rglob("*.py"):
        own = path.parent.name
        for one in all_imports()[path]:
            target = (ours(one) or "").split(".")
            other = target[1] if len(target) > 1 and target[0] == "tools" else own
            if other in TOOLS and other not in (own, *TOOLS.get(own, ())):
                wrong.append(where(path, one))
    assert wrong == []
    for folder in (tools, *(tools / name for name in TOOLS)):
        assert len(list(folder.glob("*.py"))) <= MOST_MODULES, folder


def _private_uses(tree: ast.AST, shared: set[str] = SHARED) -> Iterator[ast.Attribute]:
    """`x._name` where x is neither `self` nor `cls`, and nothing in this file is called `_name`."""
    known = shared | {
        name
        for node in ast.walk(tree)
        for name in (
            [node.attr]
            if isinstance(node, ast.Attribute) and _is_own(node.value) and _is_set(node)
            else [node.name]
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
            else [node.target.id]
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
            else [target.id for target in node.targets if isinstance(target, ast.Name)]
            if isinstance(node, ast.Assign)
            else []
        )
    }
    for node in ast.walk(tree):
        if not isinstance(node, ast.Attribute) or _is_own(node.value):
            continue
        if _is_private(node.attr) and node.attr not in known and ast.unparse(node) not in DOCUMENTED:
            yield node


def _is_private(name: str) -> bool:
    return name.startswith("_") and not name.endswith("__")


def _is_own(node: ast.AST) -> bool:
    return isinstance(node, ast.Name) and node.id in ("self", "cls")


def _is_set(node: ast.Attribute) -> bool:
    return isinstance(node.ctx, ast.Store)


def test_private_uses_are_found() -> None:
    source = """
class A:
    def __init__(self, other): self._mine = other._mine + other._theirs + self._mine._x
"""
    assert {node.attr for node in _private_uses(ast.parse(source))} == {"_theirs", "_x"}


def shared_with(module: str) -> set[str]:
    return SHARED | {"runtime": SHARED_IN_RUNTIME, "shim": SHARED_IN_SHIM}.get(part_of(module), set())


def test_nobody_touches_what_is_private_to_others() -> None:
    wrong = [
        f"{path.relative_to(PACKAGE.parent)}:{node.lineno}: {ast.unparse(node)}"
        for path in WRITTEN
        if module_of(path) != KNOWS_LAYOUTS
        for node in _private_uses(tree_of(path), shared_with(module_of(path)))
    ]
    assert wrong == []


@pytest.mark.parametrize("path", WRITTEN, ids=module_of)
def test_memory_of_others_is_read_and_changed_in_one_file(path: Path) -> None:
    if module_of(path) == KNOWS_LAYOUTS:
        return
    names = {"from_address", "memmove", "memset", "PyBytes_FromStringAndSize"}
    for node in ast.walk(tree_of(path)):
        found = node.attr if isinstance(node, ast.Attribute) else node.value if isinstance(node, ast.Constant) else ""
        assert found not in names, f"{module_of(path)}:{getattr(node, 'lineno', 0)}: {found}"


def test_generated_code_needs_only_the_middle_and_numpy() -> None:
    wrong = [
        where(path, one)
        for path, imports in all_imports().items()
        if part_of(module_of(path)) == "msgs"
        for one in imports
        if one.module.split(".")[0] not in GENERATED_MAY_IMPORT
    ]
    assert wrong == []


def circles(edges: dict[str, set[str]]) -> list[list[str]]:
    """Strongly connected groups of more than one module."""
    order: list[str] = []
    seen: set[str] = set()

    def visit(start: str, graph: dict[str, set[str]], out: list[str]) -> None:
        stack = [(start, iter(sorted(graph.get(start, ()))))]
        seen.add(start)
        while stack:
            node, following = stack[-1]
            target = next((one for one in following if one not in seen), None)
            if target is None:
                out.append(node)
                stack.pop()
            else:
                seen.add(target)
                stack.append((target, iter(sorted(graph.get(target, ())))))

    for node in sorted(edges):
        if node not in seen:
            visit(node, edges, order)
    reverse: dict[str, set[str]] = {}
    for node, targets in edges.items():
        for target in targets:
            reverse.setdefault(target, set()).add(node)
    seen.clear()
    groups = []
    for node in reversed(order):
        if node not in seen:
            group: list[str] = []
            visit(node, reverse, group)
            groups.append(group)
    return [sorted(group) for group in groups if len(group) > 1]


def test_a_circle_is_found() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [["a", "b", "c"]]


def test_imports_form_no_circle() -> None:
    edges: dict[str, set[str]] = {}
    for path, imports in all_imports().items():
        own = module_of(path)
        targets = {target for one in imports if not one.for_typing and (target := ours(one)) is not None}
        # The package itself loads what a name needs when it is used, so nothing hangs on importing it.
        edges[own] = {target for target in targets if target not in ("", own) and _is_module(f"{NAME}.{target}")}
    assert circles(edges) == []


@pytest.mark.parametrize("path", WRITTEN, ids=module_of)
def test_time_comes_from_the_loop_or_the_transport(path: Path) -> None:
    if module_of(path).startswith(KNOW_THE_TIME):
        return
    names = {"monotonic", "monotonic_ns", "time", "time_ns", "perf_counter", "perf_counter_ns"}
    for node in ast.walk(tree_of(path)):
        is_asked = isinstance(node, ast.Attribute) and ast.unparse(node.value) == "time" and node.attr in names
        is_taken = (
            isinstance(node, ast.ImportFrom) and node.module == "time" and names & {one.name for one in node.names}
        )
        assert not (is_asked or is_taken), f"{module_of(path)}:{node.lineno}: {ast.unparse(node)}"


@pytest.mark.parametrize("path", WRITTEN, ids=module_of)
def test_every_file_says_what_it_is_for(path: Path) -> None:
    assert ast.get_docstring(tree_of(path))
