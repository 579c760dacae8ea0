"""Docstrings begin with a verb or a noun phrase."""

from __future__ import annotations

import ast
from typing import TYPE_CHECKING

from support.markdown_pages import ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PACKAGE = ROOT / "rosidl_py_gen"
MODULES = [path for path in sorted(PACKAGE.rglob("*.py")) if path.relative_to(PACKAGE).parts[0] != "msgs"]
WORDS = {"What", "Whether", "Of", "As", "Let", "How"}
"""Words at the beginning of sentences that do not say what an object is or does."""


def documented(path: Path) -> Iterator[tuple[int, str]]:
    """Yield lines and texts of docstrings, those of constants included."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.lineno, node.value.value


def test_docstrings_begin_with_a_verb_or_a_noun_phrase() -> None:
    paths = [*MODULES, *(path for path in (ROOT / "tests").rglob("*.py") if "golden" not in path.parts)]
    wrong = [
        f"{path.relative_to(ROOT)}:{line}: {text.splitlines()[0]}"
        for path in paths
        for line, text in documented(path)
        if text.split() and text.split()[0].strip(",.:;") in WORDS
    ]
    assert len(MODULES) > 200 and wrong == []
