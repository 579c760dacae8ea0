"""Docstrings have the form that the API pages are made from, and begin with a verb or a noun phrase.

mkdocs --strict counts every other form as a failure. griffe reads docstrings then, but in CI only.
"""

from __future__ import annotations

import ast
import re
from typing import TYPE_CHECKING

from support.markdown_pages import ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    Documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef

KINDS = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
PACKAGE = ROOT / "rosidl_py_gen"
MODULES = [path for path in sorted(PACKAGE.rglob("*.py")) if path.relative_to(PACKAGE).parts[0] != "msgs"]
WORDS = {"What", "Whether", "Of", "As", "Let", "How"}
"""Words at the beginning of sentences that do not say what an object is or does."""
SECTION = re.compile(r"(Args|Raises|Attributes):$")


def items(docstring: str) -> Iterator[tuple[str, str]]:
    """(section, line) of everything that begins an entry of a section."""
    section = ""
    for line in docstring.splitlines():
        if not line.startswith(" "):
            found = SECTION.match(line)
            section = found[1] if found else ("" if line.strip() else section)
        elif section and re.match(r" {4}\S", line):
            yield section, line.strip()


def parameters(node: Documented) -> set[str]:
    if isinstance(node, ast.ClassDef):
        made = [one for one in node.body if isinstance(one, ast.FunctionDef) and one.name == "__init__"]
        fields = {
            one.target.id for one in node.body if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name)
        }
        return fields.union(*map(parameters, made))
    if isinstance(node, ast.Module):
        return set()
    known = node.args
    every = [*known.posonlyargs, *known.args, *known.kwonlyargs, known.vararg, known.kwarg]
    return {one.arg for one in every if one is not None}


def complaints(node: Documented) -> Iterator[str]:
    for section, line in items(ast.get_docstring(node) or ""):
        name, colon, text = line.partition(": ")
        if not (colon and text.strip()):
            yield f"{section}: {line!r} is no 'name: description'"
        elif section == "Args" and name.lstrip("*") not in parameters(node):
            yield f"Args: {name!r} is no parameter"


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
    assert wrong == []


def test_docstrings_can_be_read_by_griffe() -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)}: {complaint}"
        for path in MODULES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, KINDS)
        for complaint in complaints(node)
    ]
    assert len(MODULES) > 200 and wrong == []
