"""Write docs/internals/features.md: the features of the product, their size, and who needs them.

Run it as ``python tools/features.py``; with ``--check`` it writes nothing and fails if the page is not current.

`features.toml` contains the features: their code, tests, pages, and the evidence of a user. This program counts lines
and tests. The counts of the page may differ from the present ones by a quarter, so that few changes have to rewrite it.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from counts import PACKAGE, ROOT, is_product, lines_of_code

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

TABLE = Path(__file__).with_name("features.toml")
PAGE = ROOT / "docs" / "internals" / "features.md"
_HEAD = """\
# Features

The features of the product: lines of code, tests, pages, and the evidence that users need the feature. Evidence is a
public issue or program, or a part of the interface of ROS 2. A feature without evidence is removed after a release. A
new feature adds its row to `tools/features.toml`, and `python tools/features.py` writes this page.

- Lines are neither blank nor comments nor docstrings. Tests are functions; many have several cases. Both are rounded.
- Most tests of rclpy are programs. One test function runs all programs of a kind, and counts for `run`.
- Counts of scripts are from a survey of 1,102 scripts of 113 public repositories that use rclpy.

"""
_COLUMNS = "| Feature | Lines | Tests | Pages | Evidence of a user |\n|---|--:|--:|---|---|\n"
_ROW = re.compile(r"^\| (.+?) \| ([\d,]+) \| ([\d,]+) \| ", re.MULTILINE)
_ISSUE = re.compile(r"(?<![\w/.-])([\w.-]+/[\w.-]+)#(\d+)")
_TEST = re.compile(r"^ *(?:async )?def (test_\w+)", re.MULTILINE)
_TOLERANCE, _SMALL = 0.25, 30
"""Counts of the page may differ by this part, and by this number."""


class Feature(NamedTuple):
    """Entry of `features.toml`."""

    group: str
    name: str
    code: Sequence[str]
    tests: Sequence[str]
    pages: Sequence[str]
    evidence: str


def read(text: str) -> list[Feature]:
    """Return the features of the text of a table."""
    return [Feature(**entry) for entry in tomllib.loads(text)["feature"]]


# ------------------------------------------------------------------------------------------------------------- Counting


def product() -> dict[str, int]:
    """Return the lines of code of each source file of the product, by its path as `features.toml` writes it."""
    files = (path for folder in (PACKAGE, "templates") for path in sorted((ROOT / folder).rglob("*")))
    named = ((path.relative_to(ROOT).as_posix(), path) for path in files if path.is_file())
    return {
        name.removeprefix(f"{PACKAGE}/"): _lines(name, path.read_text(encoding="utf-8"))
        for name, path in named
        if is_product(name)
    }


def _lines(name: str, text: str) -> int:
    if not name.endswith((".py", ".pyi")):
        return lines_of_code(text)
    documented = (one for one in _statements(ast.parse(text)) if _is_text(one))
    return lines_of_code(text, {line for one in documented for line in range(one.lineno, (one.end_lineno or 0) + 1)})


def _statements(node: ast.AST) -> Iterator[ast.stmt]:
    """Yield all statements; `ast.walk` would also visit expressions, which takes five times as long."""
    for name in ("body", "orelse", "finalbody", "handlers", "cases"):
        for one in getattr(node, name, ()):
            if isinstance(one, ast.stmt):
                yield one
            yield from _statements(one)


def _is_text(statement: ast.stmt) -> bool:
    value = statement.value if isinstance(statement, ast.Expr) else None
    return isinstance(value, ast.Constant) and isinstance(value.value, str)


def all_tests() -> list[tuple[str, str]]:
    """Return the path and name of each test function."""
    files = sorted((ROOT / "tests").rglob("test_*.py"))
    return [(path.as_posix(), name) for path in files for name in _TEST.findall(path.read_text(encoding="utf-8"))]


def owners(features: Sequence[Feature], modules: Iterable[str]) -> dict[str, str]:
    """Return the path of `features.toml` that each module belongs to: the longest that is the module or contains it."""
    paths = {path for feature in features for path in feature.code}
    found = {}
    for module in modules:
        parents = (module, *map(str, PurePosixPath(module).parents))
        if path := next((one for one in parents if one in paths), ""):
            found[module] = path
    return found


def _patterns(path: str, features: Sequence[Feature]) -> list[tuple[tuple[bool, int, int], str, Feature]]:
    """Return the patterns that match a test file, with their rank.

    Patterns for the names of tests rank before those for whole files, and long names of files before long folders.
    """
    found = []
    for feature in features:
        for pattern in feature.tests:
            file, _, function = pattern.partition("::")
            if PurePosixPath(path).match(file):
                name = PurePosixPath(file).name.replace("*", "")
                found.append(((bool(function), len(name), len(file)), pattern, feature))
    return sorted(found, key=lambda one: one[0], reverse=True)


class Counts(NamedTuple):
    """Counts of all features, and what belongs to none."""

    lines: Counter[str]
    tests: Counter[str]
    tests_of_none: int
    unused_patterns: list[str]


def count(features: Sequence[Feature], modules: dict[str, int], functions: Sequence[tuple[str, str]]) -> Counts:
    """Count the lines and tests of each feature by its name."""
    lines: Counter[str] = Counter()
    features_of = {path: feature.name for feature in features for path in feature.code}
    for module, path in owners(features, modules).items():
        lines[features_of[path]] += modules[module]
    found: Counter[str] = Counter()
    used: set[str] = set()
    patterns = {path: _patterns(path, features) for path in {path for path, _ in functions}}
    for path, name in functions:
        matching = [one for one in patterns[path] if fnmatchcase(name, one[1].partition("::")[2] or "*")]
        used |= {pattern for _, pattern, _ in matching}
        if matching:
            found[matching[0][2].name] += 1
    unused = [pattern for feature in features for pattern in feature.tests if pattern not in used]
    return Counts(lines, found, len(functions) - found.total(), unused)


# ------------------------------------------------------------------------------------------------------------- The page


def rounded(number: int) -> str:
    """Return a number with two significant digits."""
    unit = 10 ** max(len(str(number)) - 2, 0)
    return f"{round(number / unit) * unit:,}"


def page(features: Sequence[Feature], counts: Counts) -> str:
    """Return the text of the page."""
    parts = [_HEAD]
    for group in dict.fromkeys(one.group for one in features):
        parts += [f"## {group}\n\n", _COLUMNS]
        parts += [_row(one, counts) for one in features if one.group == group]
        parts.append("\n")
    without = [one.name for one in features if "none found" in one.evidence]
    parts += ["## Without evidence\n\n", "In whole or in part: " + "; ".join(without) + ".\n\n"]
    parts += ["## All\n\n", _COLUMNS.replace("Pages | Evidence of a user", "Pages | ")]
    parts.append(f"| All features | {rounded(counts.lines.total())} | {rounded(counts.tests.total())} | | |\n")
    parts.append(f"| Tests of no single feature | 0 | {rounded(counts.tests_of_none)} | | |\n")
    return "".join(parts)


def _row(feature: Feature, counts: Counts) -> str:
    pages = ", ".join(f"[{one.removesuffix('.md')}](../{one})" for one in feature.pages)
    evidence = _ISSUE.sub(r"[\1#\2](https://github.com/\1/issues/\2)", feature.evidence)
    numbers = f"{rounded(counts.lines[feature.name])} | {rounded(counts.tests[feature.name])}"
    return f"| {feature.name} | {numbers} | {pages} | {evidence} |\n"


def is_current(written: str, made: str) -> bool:
    """Return True if two pages say the same, with counts that are nearly equal."""
    if _ROW.sub(r"| \1 | ", written) != _ROW.sub(r"| \1 | ", made):
        return False
    return all(
        abs(int(old.replace(",", "")) - (now := int(new.replace(",", "")))) <= max(_SMALL, _TOLERANCE * now)
        for (_, *olds), (_, *news) in zip(_ROW.findall(written), _ROW.findall(made), strict=True)
        for old, new in zip(olds, news, strict=True)
    )


def problems(features: Sequence[Feature], modules: dict[str, int], counts: Counts) -> list[str]:
    """Return what is wrong in a table: one text for each problem."""
    paths = Counter(path for feature in features for path in feature.code)
    names = Counter(feature.name for feature in features)
    owned = owners(features, modules)
    found = [f"{module}: belongs to no feature" for module in modules if module not in owned]
    found += [f"{path}: belongs to {number} features" for path, number in paths.items() if number > 1]
    found += [f"{name}: {number} features have this name" for name, number in names.items() if number > 1]
    found += [f"{path}: no module belongs to it" for path in paths if path not in owned.values()]
    found += [f"{pattern}: no test matches" for pattern in counts.unused_patterns]
    for feature in features:
        found += [f"{feature.name}: the page {one} does not exist" for one in feature.pages if not _exists(one)]
        if not feature.pages:
            found.append(f"{feature.name}: no page")
        if not feature.evidence.strip():
            found.append(f"{feature.name}: no evidence; write what was found, or none found")
    return found


def _exists(name: str) -> bool:
    return (ROOT / "docs" / name).is_file()


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing; fail if the page is not current")
    given = parser.parse_args()
    features, modules = read(TABLE.read_text(encoding="utf-8")), product()
    counts = count(features, modules, all_tests())
    found = problems(features, modules, counts)
    made = page(features, counts)
    if given.check:
        written = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
        found += [] if is_current(written, made) else [f"{PAGE.name} is not current: run python tools/features.py"]
    else:
        PAGE.write_text(made, encoding="utf-8", newline="\n")
    print("\n".join(found))
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
