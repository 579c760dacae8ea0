"""The tables of the compatibility page agree with recorded test results and recorded differences of definitions."""

from __future__ import annotations

import ast
import json
from functools import cache

import pytest
import record_distribution_changes
from compatibility_matrix import CELLS, DISTROS, FEATURES, LIMITS, PAGE, RESULTS, ROOT, named_tests, page

COMMAND = "python tools/compatibility_matrix.py"


@cache
def functions(path: str) -> dict[str, list[str]]:
    """Return the test functions of a file with their decorators."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    return {
        node.name: [ast.unparse(one) for one in node.decorator_list] for node in tree.body if isinstance(node, kinds)
    }


def test_compatibility_table_is_current() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert page(text) == text, f"run: {COMMAND} --table"


def test_table_of_definition_changes_is_current() -> None:
    text = record_distribution_changes.PAGE.read_text(encoding="utf-8")
    assert record_distribution_changes.page(text) == text, "run: python tools/record_distribution_changes.py"


def test_compatibility_table_has_known_distributions_and_features() -> None:
    for distros in CELLS.values():
        assert tuple(distros) == DISTROS
        assert all(set(cells) <= set(FEATURES) for cells in distros.values())


@pytest.mark.parametrize("test", named_tests())
def test_tests_named_by_compatibility_table_exist_and_are_not_skipped(test: str) -> None:
    path, _, name = test.partition("::")
    name, _, parameters = name.partition("[")
    decorators = functions(path).get(name)
    assert decorators is not None, f"{path} has no function {name}"
    assert not any(word in one for one in decorators for word in ("mark.skip(", "mark.xfail"))
    assert not any("only_with" in one and parameters not in one for one in decorators)


def test_recorded_tests_of_compatibility_table_have_passed() -> None:
    results = json.loads(RESULTS.read_text(encoding="utf-8"))
    assert sorted(results) == named_tests(), f"run: {COMMAND}"
    others = {test: {**counts, "passed": 0} for test, counts in results.items() if set(counts) != {"passed"}}
    assert others == {test: {"passed": 0, "skipped": count} for test, count in LIMITS.items()}
