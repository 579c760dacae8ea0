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

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "rosidl_py_gen"
FOLDERS = (PACKAGE, "templates", "tests", "tools")
SUFFIXES = (".py", ".pyi", ".jinja", ".j2", ".lark")
COMPAT = "ros_compat"
"""The room of rclpy and its companions: packages of their own, whose imports are counted separately."""
RECORD = "public_face.txt"
"""Name of the record of the public API, which `tests/slow/project/test_public_face.py` compares with the code."""
_NODE = "class runtime.Node"
_MEMBER = re.compile(r"    (?:async def |def )?(\w+)")

Tree = Mapping[str, str]
"""Texts of files by their paths below the root."""


def working_tree() -> Tree:
    """Return the source files of this checkout, and the record of the public API."""
    files = (path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*")) if path.is_file())
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
                and member.name.startswith(tuple(f"{one}/" for one in FOLDERS))
                and _is_counted(member.name)
            ):
                file = members.extractfile(member)
                assert file is not None
                found[member.name] = file.read().decode("utf-8")
        return found


def _is_counted(name: str) -> bool:
    return name.endswith((*SUFFIXES, f"/{RECORD}")) and "__pycache__" not in name


def is_product(name: str) -> bool:
    """Return True for source files of the product that are written by hand."""
    is_generated = name.startswith((f"{PACKAGE}/msgs/", f"{PACKAGE}/compiled_templates/"))
    return name.startswith((f"{PACKAGE}/", "templates/")) and name.endswith(SUFFIXES) and not is_generated


class Module:
    """Imports, private names and lines of a product module.

    Attributes:
        room: top-level room, `bags` for ``rosidl_py_gen/bags/reader.py``.
        lines: number of lines that are neither blank, nor comments, nor docstrings.
        imported: pairs of a module of the package and a name that is imported from it.
        private: private names that the module reads from objects other than `self` and `cls`, or imports, and does not
            define; one for each place.
        own: functions, classes, variables, and attributes of `self` that the module defines.
    """

    def __init__(self, name: str, text: str) -> None:
        self._package = name.split("/")[:-1]
        self.room = room_of(name.removesuffix(".py").replace("/", "."))
        self.imported: set[tuple[str, str]] = set()
        documented: set[int] = set()
        used: list[str] = []
        self.own: set[str] = set()
        for node in ast.walk(ast.parse(text)):
            match node:
                case ast.Expr(value=ast.Constant(value=str())):
                    documented.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
                case ast.ImportFrom(names=names):
                    source = self._source(node)
                    if source.split(".")[0] == PACKAGE:
                        self.imported |= {(source, alias.name) for alias in names}
                        used += [alias.name for alias in names]
                case ast.Import(names=names):
                    of_package = [alias.name for alias in names if alias.name.split(".")[0] == PACKAGE]
                    self.imported |= {(name, "") for name in of_package}
                case ast.Attribute(value=value, attr=attribute):
                    is_own = isinstance(value, ast.Name) and value.id in ("self", "cls")
                    if not is_own:
                        used.append(attribute)
                    elif isinstance(node.ctx, ast.Store):
                        self.own.add(attribute)
                case ast.FunctionDef(name=defined) | ast.AsyncFunctionDef(name=defined) | ast.ClassDef(name=defined):
                    self.own.add(defined)
                case ast.AnnAssign(target=ast.Name(id=defined)):
                    self.own.add(defined)
                case ast.Assign(targets=targets):
                    self.own |= {target.id for target in targets if isinstance(target, ast.Name)}
        self.lines = lines_of_code(text, documented)
        self.private = [one for one in used if re.fullmatch("_[^_].*", one) and one not in self.own]

    def foreign(self) -> set[tuple[str, str]]:
        """Return the imported names of modules in other rooms; a room itself is none of their names."""
        return {(source, name) for source, name in self.imported if room_of(source) not in ("", self.room)}

    def _source(self, node: ast.ImportFrom) -> str:
        above = self._package[: len(self._package) + 1 - node.level] if node.level else []
        return ".".join([*above, *filter(None, [node.module])])


@cache
def _module(name: str, text: str) -> Module:
    """Return the module; most files of two trees are equal, and reading a file once takes half the time."""
    return Module(name, text)


def lines_of_code(text: str, documented: Collection[int] = ()) -> int:
    """Return the number of lines that are neither blank nor comments; the lines `documented` are not counted."""
    lines = (line.strip() for number, line in enumerate(text.splitlines(), 1) if number not in documented)
    return sum(bool(line) and not line.startswith("#") for line in lines)


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
    # Others, such as `os._exit` and `_replace` of named tuples, are public names of the standard library.
    defined = {name for module in modules.values() for name in module.own}
    private = [one for module in modules.values() for one in module.private if one in defined]
    others = sum(lines_of_code(text) for name, text in product.items() if name not in modules)  # stubs and templates
    record = next((text for name, text in tree.items() if name.endswith(f"/{RECORD}")), "")
    face = [line for line in record.splitlines() if line and not line.startswith("#")]
    return {
        "doors: names that another room imports": len(doors),
        "doors: of these neither public nor generated": len(internal),
        "doors: modules that another room imports": len({source for source, _ in doors}),
        "doors: names that ros_compat imports": len(compat),
        "private names of other modules: uses": len(private),
        "private names of other modules: names": len(set(private)),
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
