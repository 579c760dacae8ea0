"""Read Markdown pages: their code blocks, headings, links, and the tests they name.

Knows the little Markdown that README.md and docs/ use.
"""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass
from pathlib import Path

from support.folders import ROOT, TESTS

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

_FENCE = re.compile(r"^(?P<indent> *)```(?P<language>\w*)(?P<info>[^`]*)$")
_TAB = re.compile(r'^=== "(.*)"$')
_TITLE = re.compile(r'title="([^"]*)"')
_CODE = re.compile(r"`[^`\n]*`")
_LINK = re.compile(r"\[[^\]]*\]\(([^()\s]+)\)")
_NAMED_TEST = re.compile(r"`((?:…|[\w/]*test_\w+\.py)(?:::test_\w+…?)?)`")


@dataclass(frozen=True)
class Block:
    """Fenced block; `line` is the 1-based number of its first line of code, `tab` the title of the tab around it."""

    language: str
    title: str
    text: str
    line: int
    tab: str = ""


def blocks(page: Path) -> list[Block]:
    """All blocks of a page, in order."""
    found = []
    tab = ""
    lines = iter(enumerate(page.read_text(encoding="utf-8").splitlines(), 1))
    for number, line in lines:
        if match := _TAB.match(line):
            tab = match[1]
        elif line and not line.startswith(" "):
            tab = ""
        if match := _FENCE.match(line):
            title = _TITLE.search(match["info"])
            text = _until(lines, match["indent"] + "```")
            found.append(Block(match["language"], title[1] if title else "", text, number + 1, tab=tab))
    return found


def _until(lines: object, end: str) -> str:
    taken = []
    for _, line in lines:  # type: ignore[attr-defined]
        if line.rstrip() == end:
            return textwrap.dedent("\n".join(taken)) + "\n"
        taken.append(line)
    raise ValueError(f"a block without {end!r}")


def prose(page: Path) -> str:
    """The page without its blocks."""
    kept: list[str] = []
    inside = False
    for line in page.read_text(encoding="utf-8").splitlines():
        if line.strip().startswith("```"):
            inside = not inside
        elif not inside:
            kept.append(line)
    return "\n".join(kept)


def anchors(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE)
    return {re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower()) for heading in headings}


def links(page: Path) -> list[str]:
    """Targets of all links that do not leave the repository."""
    targets = _LINK.findall(_CODE.sub("", prose(page)))
    return [target for target in targets if not re.match(r"[a-z]+:", target)]


def rows(page: Path) -> list[list[str]]:
    """Cells of every row of every table, headings and the lines below them included."""
    lines = [line.strip("|") for line in prose(page).splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.split("|")] for line in lines]


def named_tests(text: str) -> list[tuple[str, str]]:
    """(file, function) of every test a text names; ``…::`` means the file named before, a last ``…`` any ending."""
    found = []
    file = ""
    for name in _NAMED_TEST.findall(text):
        first, _, function = name.partition("::")
        file = file if first == "…" else first
        found.append((file, function))
    return found


def find_test_file(name: str) -> Path:
    """Return the path of a file of tests, which documentation names without its folder `core`, `slow` or `peers`."""
    kinds = (TESTS / "core", TESTS / "slow", TESTS / "peers")
    places = [kind / room / name for kind in kinds for room in ("", "project")]
    return next((place for place in places if place.is_file()), TESTS / name)
