"""References between docs/internals and the code: sections and tests that are named exist, and each section is needed.

A reference is `docs/internals/protocol.md 5.2` in a comment or docstring; `1.1, 1.3 to 1.6` and `3 and 4` name several.
"""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path
from typing import NamedTuple

from support.folders import ROOT
from support.markdown_pages import find_test_file

PAGES = {name: ROOT / "docs" / "internals" / f"{name}.md" for name in ("protocol", "dds", "cyclone_memory", "zenoh")}
FILES = [
    path
    for folder in ("rosidl_py_gen", "templates", "tests", "tools", "bench", "examples", "docs")
    for path in sorted((ROOT / folder).rglob("*"))
    if path.suffix in {".py", ".pyi", ".j2", ".lark", ".md"} and path not in PAGES.values()
]

_NUMBER = r"\d+(?:\.\d+)*"
_REFERENCE = re.compile(rf"internals/(\w+)\.md ({_NUMBER}(?:(?:, and|,| and| to) {_NUMBER})*)")
_SPLIT_REFERENCE = re.compile(r"internals/\w+\.md(?:$|\n)")
_HEADING = re.compile(rf"^##+ ({_NUMBER}) (.+)$", re.MULTILINE)
_TEST = re.compile(r"`([\w/]+\.py|…)?(?:::(\w+))?`")
_NOT_REFERRED = "Nothing refers to this section"


class Reference(NamedTuple):
    """Line that names sections of a page."""

    location: str
    page: str
    sections: str


@functools.cache
def sections(page: str) -> dict[str, str]:
    """Return the text below each heading up to the next one, by number."""
    _, *parts = re.split(r"^(?=##+ \d)", PAGES[page].read_text("utf-8"), flags=re.MULTILINE)
    return {_HEADING.match(part)[1]: part for part in parts}  # type: ignore[index]


def in_order(number: str) -> tuple[int, ...]:
    return tuple(map(int, number.split(".")))


def named(page: str, numbers: str) -> set[str]:
    """Return the sections that `1.1, 1.3 to 1.6` means; of a range those that exist."""
    found = set()
    for part in re.split(r", and |, | and ", numbers):
        first, _, last = part.partition(" to ")
        found |= {first, last or first}
        if last:
            found |= {one for one in sections(page) if in_order(first) < in_order(one) < in_order(last)}
    return found


@functools.cache
def references() -> list[Reference]:
    return [
        Reference(f"{path.relative_to(ROOT)}:{number}", *found.groups())
        for path in FILES
        if path != Path(__file__)
        for number, line in enumerate(path.read_text("utf-8").splitlines(), 1)
        for found in _REFERENCE.finditer(line)
    ]


def test_references_name_existing_sections_on_one_line() -> None:
    assert len(references()) > 150
    wrong = [
        one
        for one in references()
        if one.page not in PAGES or not named(one.page, one.sections) <= {*sections(one.page)}
    ]
    assert wrong == []
    assert [str(one) for one in FILES if one.suffix != ".md" and _SPLIT_REFERENCE.search(one.read_text("utf-8"))] == []


def test_sections_are_referenced_and_state_their_source() -> None:
    """A section is needed if code names it, a section that contains it, or one of its subsections."""
    for page in PAGES:
        used = set().union(*(named(page, one.sections) for one in references() if one.page == page))
        parents = {number.rpartition(".")[0] for number in sections(page)}
        for number, text in sections(page).items():
            is_needed = any(f"{one}.".startswith(f"{number}.") or f"{number}.".startswith(f"{one}.") for one in used)
            assert is_needed or _NOT_REFERRED in text, (page, number)
            assert number in parents or "Known from: " in text, (page, number)


@functools.cache
def functions_of(path: Path) -> set[str]:
    return {one.name for one in ast.walk(ast.parse(path.read_text("utf-8"))) if hasattr(one, "name")}


def test_tests_named_by_internals_pages_exist() -> None:
    """A file is named by its path below tests/; `…` is the file named before."""
    missing = []
    for page in PAGES.values():
        known_from = re.findall(r"Known from: .*?\n(?=\n|$)", page.read_text("utf-8"), re.DOTALL)
        named_tests = [found for text in known_from for found in _TEST.findall(text) if any(found)]
        assert len(named_tests) > 10
        path = Path()
        for file, test in named_tests:
            path = path if file in ("", "…") else find_test_file(file)
            if not path.is_file() or (test and test not in functions_of(path)):
                missing.append(f"{file}::{test}")
    assert missing == []
