"""The pages of docs/internals and the code: references name sections that are there, sections are needed, tests exist.

A reference is `docs/internals/protocol.md 5.2` in a comment or docstring; `1.1, 1.3 to 1.6` and `3 and 4` name several.
"""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = {name: ROOT / "docs" / "internals" / f"{name}.md" for name in ("protocol", "dds", "zenoh")}
READ = [
    path
    for folder in ("rosidl_py_gen", "templates", "tests", "bench", "examples", "docs")
    for path in sorted((ROOT / folder).rglob("*"))
    if path.suffix in {".py", ".pyi", ".j2", ".lark", ".md"} and path not in PAGES.values()
]

_NUMBER = r"\d+(?:\.\d+)*"
_REFERENCE = re.compile(rf"internals/(\w+)\.md ({_NUMBER}(?:(?:, and|,| and| to) {_NUMBER})*)")
_BROKEN_OFF = re.compile(r"internals/\w+\.md(?:$|\n)")
_HEADING = re.compile(rf"^##+ ({_NUMBER}) (.+)$", re.MULTILINE)
_TEST = re.compile(r"`([\w/]+\.py|…)?(?:::(\w+))?`")
_REASON = "Nothing refers to this section"


class Reference(NamedTuple):
    """A line that names sections of a page."""

    where: str
    page: str
    sections: str


def headings(page: str) -> list[str]:
    """The numbers of all sections of a page, in order."""
    return [found[1] for found in _HEADING.finditer(PAGES[page].read_text("utf-8"))]


def bodies(page: str) -> dict[str, str]:
    """What stands below each heading, up to the next one, by number."""
    _, *parts = re.split(r"^(?=##+ \d)", PAGES[page].read_text("utf-8"), flags=re.MULTILINE)
    return {_HEADING.match(part)[1]: part for part in parts}  # type: ignore[index]


def in_order(number: str) -> tuple[int, ...]:
    return tuple(map(int, number.split(".")))


def named(page: str, sections: str) -> set[str]:
    """The sections that `1.1, 1.3 to 1.6` means; those of a range that has gaps are the ones there are."""
    found = set()
    for part in re.split(r", and |, | and ", sections):
        first, _, last = part.partition(" to ")
        found |= {first, last or first}
        if last:
            found |= {one for one in headings(page) if in_order(first) < in_order(one) < in_order(last)}
    return found


@functools.cache
def references() -> list[Reference]:
    return [
        Reference(f"{path.relative_to(ROOT)}:{number}", *found.groups())
        for path in READ
        if path != Path(__file__)
        for number, line in enumerate(path.read_text("utf-8").splitlines(), 1)
        for found in _REFERENCE.finditer(line)
    ]


def test_there_are_references() -> None:
    assert len(references()) > 150


@pytest.mark.parametrize("page", PAGES)
def test_sections_that_are_referred_to_are_there(page: str) -> None:
    known = set(headings(page))
    wrong = [one for one in references() if one.page == page and not named(page, one.sections) <= known]
    assert wrong == []


def test_references_name_a_page_that_is_there() -> None:
    assert [one for one in references() if one.page not in PAGES] == []


def test_a_reference_stands_in_one_line_so_that_it_is_found() -> None:
    broken = [str(path) for path in READ if path.suffix != ".md" and _BROKEN_OFF.search(path.read_text("utf-8"))]
    assert broken == []


@pytest.mark.parametrize("page", PAGES)
def test_sections_are_needed_or_say_why_they_stand(page: str) -> None:
    """A section is needed when code names it, the section it is part of, or one of its parts."""
    asked = set().union(*(named(page, one.sections) for one in references() if one.page == page))
    lonely = [
        number
        for number, body in bodies(page).items()
        if _REASON not in body
        and not any(one == number or one.startswith(f"{number}.") or number.startswith(f"{one}.") for one in asked)
    ]
    assert lonely == []


@pytest.mark.parametrize("page", PAGES)
def test_sections_tell_how_they_are_known(page: str) -> None:
    parents = {number.rpartition(".")[0] for number in headings(page)}
    untold = [number for number, body in bodies(page).items() if "Known from: " not in body and number not in parents]
    assert untold == []


@functools.cache
def functions_of(path: Path) -> set[str]:
    return {one.name for one in ast.walk(ast.parse(path.read_text("utf-8"))) if hasattr(one, "name")}


@pytest.mark.parametrize("page", PAGES)
def test_tests_that_are_named_are_there(page: str) -> None:
    """A file is named by its path below tests/; `…` is the file named before."""
    known_from = re.findall(r"Known from: .*?\n(?=\n|$)", PAGES[page].read_text("utf-8"), re.DOTALL)
    named_tests = [found for text in known_from for found in _TEST.findall(text) if any(found)]
    missing, path = [], Path()
    for file, test in named_tests:
        path = path if file in ("", "…") else ROOT / "tests" / file
        if not path.is_file() or (test and test not in functions_of(path)):
            missing.append(f"{file}::{test}")
    assert missing == []
    assert len(named_tests) > 10
