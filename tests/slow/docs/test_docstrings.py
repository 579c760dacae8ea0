"""Docstrings begin with a verb or a noun phrase."""

from __future__ import annotations

import ast
import inspect
import re
from importlib import import_module
from typing import TYPE_CHECKING

from support.folders import ROOT

from rosidl_py_gen.runtime import Node

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


def methods_of_public_classes() -> Iterator[tuple[type[object], str, str]]:
    """Yield class, name and docstring of each method of a public class."""
    for module in ("runtime", "tf", "message_filters", "bags"):
        public = import_module(f"rosidl_py_gen.{module}")
        for cls in (getattr(public, name) for name in dir(public) if not name.startswith("_")):
            if inspect.isclass(cls) and cls.__module__.startswith("rosidl_py_gen."):
                for name, method in inspect.getmembers(cls, inspect.isfunction):
                    yield cls, name, inspect.getdoc(method) or ""


def test_blocking_methods_document_all_raised_errors() -> None:
    """An editor shows the docstring of `receive_sync` without the one of `receive`."""
    found, wrong = 0, []
    for cls, name, text in methods_of_public_classes():
        awaitable = getattr(cls, name.removesuffix("_sync"), None)
        if not name.endswith("_sync") or not inspect.iscoroutinefunction(awaitable):
            continue
        found += 1
        raised = set(re.findall(r"\b\w+Error\b", inspect.getdoc(awaitable) or "")) | {"WouldDeadlockError"}
        section = text.partition("\nRaises:\n")[2]
        if raised - set(re.findall(r"\b\w+Error\b", section)):
            wrong.append(f"{cls.__name__}.{name}")
    assert found > 40 and wrong == []


def test_create_methods_of_node_document_their_errors() -> None:
    names = [name for name, _ in inspect.getmembers(Node, inspect.isfunction) if name.startswith("create_")]
    texts = {name: inspect.getdoc(getattr(Node, name)) or "" for name in names}
    assert [name for name, text in texts.items() if re.search(r"([Rr]aises|[Oo]thers|exceptions) as", text)] == []
    assert all("\nRaises:\n" in texts[f"create_{kind}"] for kind in ("publisher", "subscription", "client", "service"))
