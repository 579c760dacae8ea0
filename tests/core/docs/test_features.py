"""The table of features (`tools/features.toml`) is complete, and docs/internals/features.md is made of it."""

from __future__ import annotations

from functools import cache

import pytest
from features import PAGE, TABLE, Counts, Feature, all_tests, count, is_current, page, problems, product, read

ONE = Feature("Data", "Bags", ["bags"], ["test_bags.py"], ["howto/bags.md"], "`ros2 bag`")
MODULES = {"bags/reader.py": 40, "bags/remote.py": 2}
TESTS = [("tests/bags/test_bags.py", "test_bag_is_read"), ("tests/core/bags/test_bags.py", "test_url_is_read")]


@cache
def present() -> tuple[list[Feature], dict[str, int], Counts]:
    features, modules = read(TABLE.read_text(encoding="utf-8")), product()
    return features, modules, count(features, modules, all_tests())


def test_every_module_belongs_to_one_feature_with_page_and_evidence() -> None:
    assert problems(*present()) == []


def test_features_page_is_current() -> None:
    features, _, counts = present()
    assert is_current(PAGE.read_text(encoding="utf-8"), page(features, counts)), "run python tools/features.py"


@pytest.mark.parametrize(
    ("changed", "problem"),
    [
        ({"code": ["bags/reader.py"]}, "bags/remote.py: belongs to no feature"),
        ({"code": ["bags", "bags/reader.py", "bags/remote.py"]}, "bags: no module belongs to it"),
        ({"code": ["bags", "bags"]}, "bags: belongs to 2 features"),
        ({"tests": ["test_bags.py", "test_tables.py"]}, "test_tables.py: no test matches"),
        ({"pages": ["howto/no-such-page.md"]}, "Bags: the page howto/no-such-page.md does not exist"),
        ({"pages": []}, "Bags: no page"),
        ({"evidence": " "}, "Bags: no evidence; write what was found, or none found"),
    ],
)
def test_problem_of_a_feature_is_found(changed: dict[str, str | list[str]], problem: str) -> None:
    feature = ONE._replace(**changed)
    assert problems([ONE], MODULES, count([ONE], MODULES, TESTS)) == []
    assert problems([feature], MODULES, count([feature], MODULES, TESTS)) == [problem]


def test_longest_path_and_most_exact_pattern_decide() -> None:
    urls = Feature("Data", "URLs", ["bags/remote.py"], ["test_*.py::*_url_*"], ["howto/bags.md"], "none found")
    counts = count([ONE, urls], MODULES, TESTS)
    assert (counts.lines, counts.tests) == ({"Bags": 40, "URLs": 2}, {"Bags": 1, "URLs": 1})


def test_page_stays_current_until_text_or_counts_change_much() -> None:
    written = page([ONE], count([ONE], MODULES, TESTS))
    assert is_current(written, page([ONE], count([ONE], {"bags/reader.py": 60}, TESTS)))
    assert not is_current(written, page([ONE], count([ONE], {"bags/reader.py": 200}, TESTS)))
    assert not is_current(written, page([ONE._replace(evidence="none found")], count([ONE], MODULES, TESTS)))
