"""Rules of the code that no linter can express; those of imports are contracts in pyproject.toml (`lint-imports`)."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "rosidl_py_gen"
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
    "_files",
    "_metadata",
    "_stored_channels",
    "_read_unindexed",
    "_messages_as_stored",
    "_inherit",
    "_omitted",
    "_statistics",
    "_add_schema",
    "_copy_metadata",
    "_copy_attachment",
}
# The same for the shim: what entities have for executors, where every public name would be one of rclpy's.
SHARED_IN_SHIM = {
    "_rosidl_destroy_clock",
    "_rosidl_destroy_subscription",
    "_rosidl_forget",
    "_rosidl_on_destroy",
    "_rosidl_task",
    "_executor_event",
    "_rosidl_endpoints",
    "_rosidl_replaced_take",
    "_rosidl_take_method",
    "_rosidl_take_arguments",
    "_rosidl_take_request",
    "_rosidl_context",
    "_rosidl_from_runtime",
    "_rosidl_has_one_thread",
    "_goal_info",
    "_rosidl_is_dispatched",
    "_rosidl_is_ready",
    "_rosidl_queue",
    "_rosidl_entity_lists",
    "_pending",
    "_rosidl_publish_feedback",
    "_rosidl_publish_status",
    "_rosidl_queues",
    "_set_executor",
    "_set_ros_time_is_active",
    "_rosidl_take",
    "_timer",
    "_TYPE_SUPPORT",
    "_update_state",
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
RUN_BY_RCLPY = ("ros_compat/programs", "ros_compat/semantics", "companions/programs", "interop_rclpy/peers")
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
        "runtime.time.clock",
        "runtime.loop.loop_binding",
        "runtime.loop.virtual_time",
        "base.interrupts",
        "generator_cli",
        "ros_cli.doctor.peers",
        "ros_cli.recording.writer",
        "ros_cli.bag.display",
        "ros_cli.bag.migrate",
        "ros_cli.foxglove",
        "ros_cli.launch.service",
        "ros_cli.message_expressions",
        "ros_cli.message_text",
        "ros_cli.topic.statistics",
        "bags.splitting_writer",
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


def parsed_modules() -> Iterator[tuple[str, ast.Module]]:
    """Parse all modules that are not generated, one at a time: together the trees take 100 MB."""
    for path in sorted(PACKAGE.rglob("*.py")):
        if not is_in(module := module_of(path), ("msgs",)):
            yield module, ast.parse(path.read_text(encoding="utf-8"))


def _used(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Lines and names: attributes with what they are of, names that are imported, and short texts for `getattr`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            yield node.lineno, f"{node.value.id if isinstance(node.value, ast.Name) else ''}.{node.attr}"
        elif isinstance(node, ast.ImportFrom):
            yield from ((node.lineno, f"{node.module}.{alias.name}") for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
            yield node.lineno, node.value


def test_restricted_functions_are_used_where_they_may_be() -> None:
    wrong = [
        f"{module}:{line}: {name}"
        for module, tree in parsed_modules()
        for line, name in _used(tree)
        for pattern, modules in RESTRICTED.items()
        if re.fullmatch(pattern, name) and not is_in(module, modules)
    ]
    assert wrong == []


def test_third_party_packages_are_those_of_the_contract() -> None:
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
    found = {
        (module, name.partition(".")[0])
        for module, tree in parsed_modules()
        for node in ast.walk(tree)
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module or ""]
            if isinstance(node, ast.ImportFrom) and not node.level
            else []
        )
    }
    wrong = {
        (module, name)
        for module, name in found
        if name not in (known | of_rclpy if is_in(module, ("ros_compat",)) else known)
    }
    assert wrong == set()


def _private_uses(tree: ast.AST, shared: set[str] = SHARED) -> Iterator[ast.Attribute]:
    """`x._name` where x is neither `self` nor `cls`, and nothing in this file is called `_name`."""
    known = shared | _own_names(tree)
    for node in ast.walk(tree):
        if not isinstance(node, ast.Attribute) or _is_own(node.value):
            continue
        if _is_private(node.attr) and node.attr not in known and ast.unparse(node) not in DOCUMENTED:
            yield node


def _own_names(tree: ast.AST) -> set[str]:
    """Functions, classes, variables, and attributes of `self` that this file defines."""
    return {
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


def _is_private(name: str) -> bool:
    return name.startswith("_") and not name.endswith("__") and name != "_asdict"  # public in named tuples


def _is_own(node: ast.AST) -> bool:
    return isinstance(node, ast.Name) and node.id in ("self", "cls")


def _is_set(node: ast.Attribute) -> bool:
    return isinstance(node.ctx, ast.Store)


def test_no_module_touches_what_is_private_to_others() -> None:
    more = {"runtime": SHARED_IN_RUNTIME, "bags": SHARED_IN_BAGS, "ros_compat": SHARED_IN_SHIM}
    wrong = [
        f"{module}:{node.lineno}: {ast.unparse(node)}"
        for module, tree in parsed_modules()
        if module != KNOWS_LAYOUTS
        for node in _private_uses(tree, SHARED | more.get(module.partition(".")[0], set()))
    ]
    assert wrong == []


def _private_texts(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Lines and private names that are imported, or given to `setattr` and the like."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.Call) and re.search("(set|get|has|del)attr$", ast.unparse(node.func)):
            names = [str(one.value) for one in node.args[:2] if isinstance(one, ast.Constant)]
        else:
            continue
        yield from ((node.lineno, name) for one in names if _is_private(name := one.rpartition(".")[2]))


def test_tests_use_private_names_only_if_the_documentation_lists_them() -> None:
    tests = Path(__file__).resolve().parent
    text = (PACKAGE.parent / "docs/internals/architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"(?m)^\|([^|]+)", text.partition("## Private structure that tests use")[2])
    listed = {name for row in rows for name in re.findall(r"`(_\w+)`", row)}
    ours = {name for _, tree in parsed_modules() for name in _own_names(tree) if _is_private(name)}
    wrong = []
    for path in sorted(tests.rglob("*.py")):
        if not path.relative_to(tests).as_posix().startswith(("golden/", *RUN_BY_RCLPY)):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            used = [(node.lineno, node.attr) for node in _private_uses(tree, NAMED_TUPLES)]
            used += [(line, name) for line, name in _private_texts(tree) if name not in _own_names(tree)]
            wrong += [f"{path.relative_to(tests)}:{line}: {name}" for line, name in used if name in ours - listed]
    assert listed and wrong == []


def test_no_two_classes_share_a_name() -> None:
    """Classes of `ros_compat` have rclpy's names."""
    modules: dict[str, list[str]] = {}
    for module, tree in parsed_modules():
        # A class for type checkers and the class in the other branch are one class.
        of_checkers = {
            one
            for node in ast.walk(tree)
            if isinstance(node, ast.If) and node.orelse and ast.unparse(node.test) == "TYPE_CHECKING"
            for one in node.body
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef) and node not in of_checkers and not is_in(module, ("ros_compat",)):
                modules.setdefault(node.name, []).append(module)
    assert len(modules) > 700
    assert {name: places for name, places in modules.items() if len(places) > 1} == {}
