"""Print counts of the code base that should not grow unnoticed: doors, private accesses, members, options, lines.

Run it as ``python tools/counts.py [--against COMMIT]``. It reads files only: nothing is imported, built or fetched.
With ``--against`` it also prints the counts of a commit of this repository, and the differences.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import subprocess
import sys
import tarfile
from collections.abc import Collection, Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "rosidl_py_gen"
FOLDERS = (PACKAGE, "templates", "tests", "tools")
SUFFIXES = (".py", ".pyi", ".jinja", ".j2", ".lark")
PAGE = "docs/internals/architecture.md"
"""Page that lists the private names which other modules use."""
COMPAT = "ros_compat"
"""The room of rclpy and its companions: packages of their own, whose imports are counted separately."""
RECORD = "public_face.txt"
"""Name of the record of the public API, which `tests/slow/project/test_public_face.py` compares with the code."""
PUBLIC_IN_PYTHON = {
    *("_asdict", "_field_defaults", "_fields", "_make", "_replace"),  # of named tuples
    *("sys._current_frames", "sys._getframe", "sys._is_gil_enabled", "os._exit"),
    *("asyncio._get_running_loop", "asyncio._set_running_loop"),  # in asyncio.__all__, for those who write event loops
}
"""Names that are documented in spite of their underscore, for every object or only with the module."""
_NODE = "class runtime.Node"
_MEMBER = re.compile(r"    (?:async def |def )?(\w+)")

Tree = Mapping[str, str]
"""Texts of files by their paths below the root."""


def working_tree() -> Tree:
    """Return the source files of this checkout, the record of the public API, and the page about the architecture."""
    files = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*")) if path.is_file()]
    files.append(ROOT / PAGE)
    named = ((path.relative_to(ROOT).as_posix(), path) for path in files)
    return {name: path.read_text(encoding="utf-8") for name, path in named if _is_counted(name)}


def tree_of(commit: str) -> Tree:
    """Return the same files of a commit.

    Raises:
        subprocess.CalledProcessError: the repository does not contain the commit.
    """
    command = ["git", "-C", str(ROOT), "archive", commit]
    archive = subprocess.run(command, capture_output=True, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as members:
        found = {}
        for member in members:
            if (
                member.isfile()
                and member.name.startswith((*(f"{one}/" for one in FOLDERS), PAGE))
                and _is_counted(member.name)
            ):
                file = members.extractfile(member)
                assert file is not None
                found[member.name] = file.read().decode("utf-8")
        return found


def _is_counted(name: str) -> bool:
    return name.endswith((*SUFFIXES, f"/{RECORD}", PAGE)) and "__pycache__" not in name


def is_product(name: str) -> bool:
    """Return True for source files of the product that are written by hand."""
    is_generated = name.startswith((f"{PACKAGE}/msgs/", f"{PACKAGE}/compiled_templates/"))
    return name.startswith((f"{PACKAGE}/", "templates/")) and name.endswith(SUFFIXES) and not is_generated


class Use(NamedTuple):
    """Use of a private name.

    Attributes:
        line: line number.
        name: private name.
        text: the name with the object it is read from, as in the file.
    """

    line: int
    name: str
    text: str


class Listed(NamedTuple):
    """Private name that a page permits.

    Attributes:
        name: private name.
        module: module that may use the name, also in its submodules; "" for every module.
    """

    name: str
    module: str

    def permits(self, name: str, module: str) -> bool:
        """Return True if the module may use the name."""
        return name == self.name and f"{module}.".startswith(f"{self.module}." if self.module else "")


def listed_names(page: str) -> list[Listed]:
    """Return the private names that the product may use, from the text of the page about the architecture."""
    rows = _rows(page, "## Private names that other modules use")
    names = [
        (re.findall(r"`(_\w+)`", name), re.findall(r"`([\w.]+)`", modules) or [""]) for name, _, modules, *_ in rows
    ]
    return [Listed(name, module) for found, modules in names for name in found for module in modules]


def listed_in_tests(page: str) -> set[str]:
    """Return the private names of the product that tests may use, from the same text."""
    return {
        name for row in _rows(page, "## Private structure that tests use") for name in re.findall(r"`(_\w+)`", row[0])
    }


def _rows(page: str, heading: str) -> list[list[str]]:
    section = page.partition(f"\n{heading}\n")[2].partition("\n## ")[0]
    rows = [line.strip("|").split("|") for line in section.splitlines() if line.startswith("|")]
    return rows[2:]


class Module:
    """Imports, private names and lines of a module.

    Attributes:
        room: top-level room, `bags` for ``rosidl_py_gen/bags/reader.py``.
        lines: number of lines that are neither blank, nor comments, nor docstrings.
        imported: pairs of a module of the package and a name that is imported from it.
        private: private names that the module reads from objects other than `self` and its own classes, imports, or
            passes to `getattr` and the like, and does not define.
        own: functions, classes, variables, and attributes of `self` that the module defines.
    """

    def __init__(self, name: str, text: str) -> None:
        self._package = name.split("/")[:-1]
        self.room = room_of(name.removesuffix(".py").replace("/", "."))
        self.imported: set[tuple[str, str]] = set()
        documented: set[int] = set()
        used: list[Use] = []
        self.own: set[str] = set()
        classes: set[ast.AST] = set()  # uses of `cls` in class methods; elsewhere it may be any class
        for node in ast.walk(ast.parse(text)):
            match node:
                case ast.Expr(value=ast.Constant(value=str())):
                    documented.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
                case ast.ImportFrom(names=names):
                    source = self._source(node)
                    if source.split(".")[0] == PACKAGE:
                        self.imported |= {(source, alias.name) for alias in names}
                    used += [Use(node.lineno, alias.name, f"{source}.{alias.name}") for alias in names]
                case ast.Import(names=names):
                    of_package = [alias.name for alias in names if alias.name.split(".")[0] == PACKAGE]
                    self.imported |= {(name, "") for name in of_package}
                case ast.Attribute(value=value, attr=attribute):
                    if not _is_own(value, classes):
                        used.append(Use(node.lineno, attribute, ast.unparse(node) if is_private(attribute) else ""))
                    elif isinstance(node.ctx, ast.Store):
                        self.own.add(attribute)
                case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name), args=[of, *_] as arguments) if (
                    re.search("(set|get|has|del)attr$", name) and not _is_own(of, classes)
                ):
                    texts = [str(one.value) for one in arguments[:2] if isinstance(one, ast.Constant)]
                    owner = "" if isinstance(of, ast.Constant) else f"{ast.unparse(of)}."
                    used += [Use(node.lineno, text.rpartition(".")[2], owner + text) for text in texts]
                case ast.FunctionDef(name=defined) | ast.AsyncFunctionDef(name=defined):
                    self.own.add(defined)
                case ast.ClassDef(name=defined, body=body):
                    self.own.add(defined)
                    methods = (one for one in body if isinstance(one, ast.FunctionDef) and _first_name(one) == "cls")
                    inner = (one for method in methods for one in ast.walk(method))
                    classes.update(one for one in inner if isinstance(one, ast.Name) and one.id == "cls")
                case ast.AnnAssign(target=ast.Name(id=defined)):
                    self.own.add(defined)
                case ast.Assign(targets=targets):
                    self.own |= {target.id for target in targets if isinstance(target, ast.Name)}
        self.lines = lines_of_code(text, documented)
        self.private = [
            one
            for one in sorted(used)
            if is_private(one.name) and one.name not in self.own and PUBLIC_IN_PYTHON.isdisjoint((one.name, one.text))
        ]

    def foreign(self) -> set[tuple[str, str]]:
        """Return the imported names of modules in other rooms; a room itself is none of their names."""
        return {(source, name) for source, name in self.imported if room_of(source) not in ("", self.room)}

    def _source(self, node: ast.ImportFrom) -> str:
        above = self._package[: len(self._package) + 1 - node.level] if node.level else []
        return ".".join([*above, *filter(None, [node.module])])


def is_private(name: str) -> bool:
    """Return True for names with an underscore, except those that Python defines, such as `__init__`."""
    return name.startswith("_") and not name.endswith("__") and name != "_"


def _first_name(function: ast.FunctionDef) -> str:
    return next((one.arg for one in (*function.args.posonlyargs, *function.args.args)), "")


def _is_own(node: ast.AST, classes: Collection[ast.AST]) -> bool:
    return isinstance(node, ast.Name) and (node.id == "self" or node in classes)


@cache
def _module(name: str, text: str) -> Module:
    """Return the module; most files of two trees are equal, and reading a file once takes half the time."""
    return Module(name, text)


def lines_of_code(text: str, documented: Collection[int] = ()) -> int:
    """Return the number of lines that are neither blank nor comments; the lines `documented` are not counted."""
    lines = (line.strip() for number, line in enumerate(text.splitlines(), 1) if number not in documented)
    return sum(bool(line) and not line.startswith("#") for line in lines)


def module_name(path: str) -> str:
    """Return the name of a product module in the package, `bags.reader` for ``rosidl_py_gen/bags/reader.py``."""
    return path.removeprefix(f"{PACKAGE}/").removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def room_of(module: str) -> str:
    """Return the top-level room of a module, `bags` for ``rosidl_py_gen.bags.reader``."""
    return module.split(".")[1] if "." in module else ""


def counts(tree: Tree) -> dict[str, int]:
    """Return all counts of a tree, by the names that are printed."""
    product = {name: text for name, text in tree.items() if is_product(name)}
    tests = {name: text for name, text in tree.items() if name.startswith("tests/") and name.endswith(".py")}
    tests = {name: text for name, text in tests.items() if "/golden/" not in name}
    support = {name: text for name, text in tests.items() if name.startswith("tests/support/")}
    modules = {name: _module(name, text) for name, text in product.items() if name.endswith(".py")}
    doors = {pair for one in modules.values() if one.room != COMPAT for pair in one.foreign()}
    internal = {pair for pair in doors if not _is_public(*pair, stubs=product)}
    compat = {pair for one in modules.values() if one.room == COMPAT for pair in one.foreign()}
    defined = {name for module in modules.values() for name in module.own}
    private = [
        (use.name, module_name(path))
        for path, module in modules.items()
        for use in module.private
        if use.name in defined
    ]
    listed = listed_names(tree.get(PAGE, ""))
    others = sum(lines_of_code(text) for name, text in product.items() if name not in modules)  # stubs and templates
    record = next((text for name, text in tree.items() if name.endswith(f"/{RECORD}")), "")
    face = [line for line in record.splitlines() if line and not line.startswith("#")]
    return {
        "doors: names that another room imports": len(doors),
        "doors: of these neither public nor generated": len(internal),
        "doors: modules that another room imports": len({source for source, _ in doors}),
        "doors: names that ros_compat imports": len(compat),
        "private names of other modules: uses": len(private),
        "private names of other modules: names": len({name for name, _ in private}),
        "private names of other modules: uses that are not listed": sum(
            not any(one.permits(*use) for one in listed) for use in private
        ),
        "members of Node": len(_members(record)),
        "options of commands": sum(line.startswith("    -") for line in _section(record, " --help")),
        "commands": sum(not line.startswith(" ") for line in _section(record, " --help")),
        "public face: lines": len(face),
        "product: files": len(product),
        "product: lines": sum(text.count("\n") for text in product.values()),
        "product: lines of code": others + sum(one.lines for one in modules.values()),
        "tests: files": len(tests),
        "tests: lines": sum(text.count("\n") for text in tests.values()),
        "tests: functions": sum(len(re.findall(r"(?m)^ *(?:async )?def test_", text)) for text in tests.values()),
        "tools: lines": sum(text.count("\n") for name, text in tree.items() if name.startswith("tools/")),
        "tests: lines of support": sum(text.count("\n") for text in support.values()),
    }


def _is_public(module: str, name: str, stubs: Tree) -> bool:
    """Return True for errors, classes of generated packages, and names above the first comment of a stub."""
    room = room_of(module)
    if room in ("errors", "msgs"):
        return True
    texts = (stubs.get(f"{PACKAGE}/{folder}__init__.pyi", "") for folder in (f"{room}/", ""))
    return any(f" as {name}\n" in text.partition("#")[0] for text in texts)


def _members(record: str) -> set[str]:
    _, _, after = record.partition(f"\n{_NODE}\n")
    lines = re.match(r"(?: {4}.*\n)*", after)
    assert lines is not None
    return {found[1] for line in lines[0].splitlines() if (found := _MEMBER.match(line)) and found[1] != "__init__"}


def _section(record: str, title: str) -> list[str]:
    """Return the lines below all headings that end with `title`."""
    parts = re.split(r"(?m)^# (.*)\n", record)
    texts = (text for heading, text in zip(parts[1::2], parts[2::2], strict=True) if heading.endswith(title))
    return [line for text in texts for line in text.splitlines() if line]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--against", metavar="COMMIT", help="also print the counts of this commit, and the differences")
    given = parser.parse_args()
    found = counts(working_tree())
    old: dict[str, int] = {}
    if given.against:
        try:
            old = counts(tree_of(given.against))
        except subprocess.CalledProcessError:
            print(f"{given.against}: this repository does not contain the commit", file=sys.stderr)
            return 1
    width = max(map(len, found))
    for name, value in found.items():
        change = f" {old[name]:8} {value - old[name]:+7}" if old else ""
        print(f"{name:{width}} {value:8}{change}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
