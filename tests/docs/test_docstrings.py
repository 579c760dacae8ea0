"""Docstrings have the form that the API pages are made from: mkdocs --strict counts every other one as a failure.

griffe reads them then, but in CI only; this is the same in a second.
"""

from __future__ import annotations

import ast
import re
from typing import TYPE_CHECKING

from support.markdown_pages import ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator

    Documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef

PACKAGE = ROOT / "rosidl_py_gen"
MODULES = [path for path in sorted(PACKAGE.rglob("*.py")) if path.relative_to(PACKAGE).parts[0] != "msgs"]
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
    """What `Args` may name: of a class, the constructor's, or the fields of a dataclass."""
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


def test_nothing_silences_what_strict_counts() -> None:
    script = ROOT / ".ci/run"
    if script.exists():  # an sdist has none
        (build,) = [line for line in script.read_text(encoding="utf-8").splitlines() if line.startswith("mkdocs build")]
        assert "--strict" in build and not re.search(r" -q\b|--quiet", build)


def test_docstrings_can_be_read_by_griffe() -> None:
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    wrong = [
        f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)}: {complaint}"
        for path in MODULES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, kinds)
        for complaint in complaints(node)
    ]
    assert len(MODULES) > 200 and wrong == []
