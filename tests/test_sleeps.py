"""Tests wait for what happens, not for a time: what sleeps for a fixed time, outside a loop that looks, says why."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

TESTS = Path(__file__).parent
LOOPS = ast.While | ast.For | ast.AsyncFor | ast.comprehension | ast.ListComp


def fixed(node: ast.AST) -> Iterator[ast.Call]:
    """Calls of `time.sleep` that nothing repeats."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, LOOPS):
            continue
        if isinstance(child, ast.Call) and ast.unparse(child.func) == "time.sleep":
            yield child
        yield from fixed(child)


def test_fixed_sleeps_are_few_and_say_why() -> None:
    found: list[str] = []
    for path in sorted(TESTS.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "time.sleep(" in text:
            lines = text.splitlines()
            found += [f"{path.name}: {lines[call.lineno - 1].strip()}" for call in fixed(ast.parse(text))]
    assert [line for line in found if "  # " not in line] == []
    assert len(found) <= 16
