"""Counts, lists and code of the pages agree with the package and with each other."""

from __future__ import annotations

import ast
import builtins
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib
from support.folders import ROOT
from support.markdown_pages import PAGES, blocks, prose, rows

import rosidl_py_gen
from rosidl_py_gen import bags, numpy, runtime, tf
from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.compiler.frontend.bundled import BundledInterfaces
from rosidl_py_gen.prefix.launch_packages import REPOSITORIES, install_command_of

if TYPE_CHECKING:
    from collections.abc import Iterator

SITE = [page for page in PAGES if "internals" not in page.parts]
TAUGHT = [page for page in SITE if page.parent.name in ("howto", "start")]
NUMBERS = {"two": 2, "three": 3, "four": 4, "five": 5, "six": 6, "seven": 7, "eight": 8, "nine": 9}
ITEM = r"(?:[-*]|\d\.) [^\n]*\n(?:  +[^\n]*\n)*"
IN_OUTPUT = re.compile(r"interfaces in|files written")
"""Lines of output that count packages of an example; code blocks compare them."""
PLACES = ("--path", "pyproject.toml", "AMENT_PREFIX_PATH", "installed", "bundled packages")
"""Places of the search path in their order."""


def page_id(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def test_pages_state_correct_number_of_bundled_packages() -> None:
    count = len(BundledInterfaces.of(Distribution.DEFAULT).packages)
    found = []
    for page in SITE:
        for line in page.read_text(encoding="utf-8").splitlines():
            for number, other in re.findall(r"\b(\d+) (other )?(?:message |interface |bundled )?packages\b", line):
                if not IN_OUTPUT.search(line):
                    found.append((page_id(page), int(number) + bool(other)))
    assert len(found) >= 4 and [one for one in found if one[1] != count] == []


def found_on_pages(pattern: str) -> dict[str, list[str]]:
    """Return the matches of a pattern on README and the pages that have some."""
    found = {page_id(page): re.findall(pattern, " ".join(prose(page).split())) for page in SITE}
    return {name: matches for name, matches in found.items() if matches}


def test_pages_state_python_versions_of_project() -> None:
    versions = re.findall(r"Python :: (3\.\d+)\"", (ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    stated = found_on_pages(r"Python (3\.\d+ to 3\.\d+)")
    del stated["docs/background/compare.md"]  # versions of another project
    assert stated.keys() >= {"README.md", "docs/index.md", "docs/start/install.md", "docs/reference/compatibility.md"}
    assert {one for ranges in stated.values() for one in ranges} == {f"{versions[0]} to {versions[-1]}"}


def test_pages_state_all_distributions() -> None:
    names = [name.capitalize() for name in Distribution.BUNDLED]
    stated = found_on_pages(rf"{names[0]}(?:, \w+)+ and \w+|{names[0]} to \w+")
    assert stated.keys() >= {"README.md", "docs/index.md", "docs/reference/compatibility.md"}
    complete = {f"{', '.join(names[:-1])} and {names[-1]}", f"{names[0]} to {names[-1]}"}
    assert {one for lists in stated.values() for one in lists} - complete == set()


def test_counts_of_public_programs_are_those_of_parity_page() -> None:
    (row,) = [row for row in rows(ROOT / "docs/internals/parity.md") if len(row) == 5 and row[0] == "all"]
    _, programs, unchanged, equal, _ = row
    text = " ".join(prose(ROOT / "docs/reference/compatibility.md").split())
    assert f"runs {unchanged} of {programs} programs" in text and equal.replace("of", "of the") in text
    assert f"[{programs} public programs]" in (ROOT / "docs/internals/features.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", SITE, ids=page_id)
def test_lists_have_number_of_items_stated_by_introduction(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for introduction, items in re.findall(rf"^([^\n]+(?:\n[^\n]+)*:)\n\n((?:{ITEM})+)", text, re.MULTILINE):
        stated = re.match(rf"(?:The |These )?({'|'.join(NUMBERS)})\b", introduction, re.IGNORECASE)
        if stated:
            assert len(re.findall(ITEM, items)) == NUMBERS[stated[1].lower()], introduction


@pytest.mark.parametrize("page", SITE, ids=page_id)
def test_page_repeats_no_line(page: Path) -> None:
    shown = re.sub(r"```.*?```|<!--.*?-->", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    lines = [line for line in shown.splitlines() if len(line) > 60 and not line.startswith(("=", "|--"))]
    assert {line for line in lines if lines.count(line) > 1} == set()


def test_each_error_of_errors_page_exists_and_is_listed_once() -> None:
    names = [name for row in rows(ROOT / "docs/reference/errors.md") for name in re.findall(r"`(\w+Error)\b", row[0])]
    assert len(names) > 20 and len(names) == len(set(names))
    modules = (rosidl_py_gen, runtime, bags, numpy, tf, builtins)
    assert [name for name in names if not any(hasattr(module, name) for module in modules)] == []


def test_search_path_order_is_described_consistently() -> None:
    texts = [" ".join(prose(page).split()) for page in SITE]
    for file in ("generator_cli/commands.py", "ros_cli/options.py"):
        texts.append(" ".join((ROOT / "rosidl_py_gen" / file).read_text(encoding="utf-8").replace('"', "").split()))
    for text in texts:
        for sentence in re.split(r"[.;] ", text):
            at = [sentence.find(place) for place in PLACES if place in sentence]
            if len(at) > 2 and re.search(r"\b(then|before|order|first)\b", sentence):
                assert at == sorted(at), sentence


def test_every_extra_is_on_the_install_page() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    shown = " ".join(row[0] for row in rows(ROOT / "docs/start/install.md"))
    missing = [name for name in project["optional-dependencies"] if f"`{name}`" not in shown]
    assert missing == ["test-without-dds"]


def test_howto_launch_page_has_command_of_launch_error_and_names_all_packages() -> None:
    page = ROOT / "docs/howto/launch.md"
    commands = [one.text.strip() for one in blocks(page) if "--install" in one.text]
    assert commands[0] == install_command_of("launch")
    (cell,) = [row[1] for row in rows(page) if row[0] == "Packages"]
    assert set(re.findall(r"\w+_\w+|launch", cell)) == {name for names in REPOSITORIES.values() for name in names}


def stored(tree: ast.AST) -> Iterator[str]:
    """Yield the names that code defines, of all scopes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield from ((alias.asname or alias.name).partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
            yield node.id
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.ExceptHandler) and node.name:
            yield node.name


@pytest.mark.parametrize("page", TAUGHT, ids=page_id)
def test_visible_code_uses_names_of_visible_code_only(page: Path) -> None:
    """Files and programs of tabs stand alone; other blocks continue the page."""
    built_in = {*dir(builtins), "__file__", "__name__"}
    known = set(built_in)
    for block in blocks(page):
        if block.language != "python":
            continue
        flags = ast.PyCF_ONLY_AST | ast.PyCF_ALLOW_TOP_LEVEL_AWAIT
        tree: ast.Module = compile(block.text, str(page), "exec", flags)
        used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}
        defined = set(stored(tree))
        is_alone = bool(block.title) or block.tab in ("Blocking", "rclpy")
        assert used - defined - (built_in if is_alone else known) == set(), f"{page_id(page)}:{block.line}"
        if not is_alone:
            known |= defined


@pytest.mark.parametrize("page", TAUGHT, ids=page_id)
def test_visible_code_reads_bags_that_visible_code_or_a_command_writes(page: Path) -> None:
    shown = blocks(page)
    written = {name for block in shown for name in re.findall(r"BagWriter\(\"([^\"]+)\"", block.text)}
    commands = "\n".join(block.text for block in shown if block.language == "sh")
    for block in shown:
        for name in re.findall(r"BagReader\(\"([^\"]+)\"", block.text) if block.language == "python" else ():
            assert name in written or name in commands, f"{page_id(page)}:{block.line}: {name}"
