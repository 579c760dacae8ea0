"""List the functions of the product that nothing written by other people reaches.

Run it as ``python tools/coverage_by_strangers.py [SUITE ...]``, in an environment with the extra test-all and the
package coverage. A suite runs programs, tests, recordings or definitions that other people or other implementations
made, under coverage, subprocesses too. All suites that need no checkouts run by default. The others need the option
that names their checkouts, and are skipped without it. Nothing is fetched.

The program prints the unreached lines by room and function, and a table of the rooms. ``--write`` records the unreached
functions in docs/internals/only_our_tests.txt. ``--check`` fails if a function is unreached that is not recorded; a
function that has moved within its room is recorded.

``--data FOLDER`` stores the measurements, and does not run a suite again that is in the folder. ``--own FILE`` names
measurements of our own tests: lines that these do not reach either are counted separately.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from counts import PACKAGE, ROOT, is_product

RECORD = ROOT / "docs" / "internals" / "only_our_tests.txt"
_RC = """\
[run]
source = {source}
data_file = {data}
parallel = true
patch =
    _exit
    execv
    subprocess
disable_warnings =
    couldnt-parse
    module-not-imported
    module-not-measured
    module-not-python
    no-data-collected
    trace-changed
"""
"""Without `sigterm`: its handler would end programs that handle SIGTERM themselves, as those for rclpy do."""
_GRACE_S = 60
"""Seconds that an interrupted suite has to store its measurement."""


class Suite(NamedTuple):
    """Programs, tests or recordings of other people.

    Attributes:
        about: what other people made of it.
        tests: for pytest, patterns for the end of the paths of test files.
        program: a program of this repository instead, and the arguments before the checkouts.
        option: the option that names the checkouts.
        skipped: tests that are left out, as ``-k`` of pytest takes them.
    """

    about: str
    tests: tuple[str, ...] = ()
    program: tuple[str, ...] = ()
    option: str = ""
    skipped: str = ""


SUITES = {
    "vectors": Suite("bytes recorded from rclpy", ("cdr/test_vectors.py",)),
    "bags": Suite("bags of other tools", ("test_foreign_bags.py", "test_recorded_distributions.py")),
    "setup": Suite(
        "idioms of public setup.py files, against setuptools", ("test_setup_idioms.py", "test_setup_snippets.py")
    ),
    "docs": Suite("code blocks of the documentation", ("docs/test_code_blocks.py",)),
    "interop": Suite("programs on Cyclone DDS and Fast DDS", ("interop/test_*.py",)),
    "interop_cdr": Suite("Fast-CDR", ("interop_cdr/test_*.py",)),
    "interop_rclpy": Suite("nodes of real rclpy", ("interop_rclpy/test_*.py",), skipped="soak"),
    "interop_scripts": Suite("programs for rclpy, against real rclpy", ("interop_scripts/test_*.py",)),
    "interop_zenoh": Suite("programs on Zenoh", ("interop_zenoh/test_*.py",)),
    "rclpy": Suite("rclpy's own tests", program=("run_rclpy_tests.py",), option="rclpy"),
    "companions": Suite(
        "tests of rclpy's companions", program=("run_rclpy_tests.py", "--companions"), option="companions"
    ),
    "programs": Suite("public programs", program=("run_third_party_programs.py",), option="programs"),
    "launch": Suite("public launch files", program=("run_public_launch_files.py",), option="launch"),
    "definitions": Suite("public message packages", option="definitions"),
}


# ------------------------------------------------------------------------------------------------------------- Running


class Outcome(NamedTuple):
    """Last line of a suite's output, and how long it ran."""

    suite: str
    text: str
    seconds: float


def command(name: str, checkouts: Path | None, folder: Path) -> list[str]:
    """Return the arguments of ``coverage run`` for a suite."""
    suite = SUITES[name]
    if suite.tests:
        files = sorted(path for path in (ROOT / "tests").rglob("test_*.py") if any(map(path.match, suite.tests)))
        skipped = ["-k", f"not ({suite.skipped})"] if suite.skipped else []
        return ["-m", "pytest", "-q", "-p", "no:cacheprovider", *skipped, *map(str, files)]
    if suite.program:
        places = (path for top in ("tools", "tests") for path in (ROOT / top).rglob(suite.program[0]))
        return [str(next(places)), *suite.program[1:], str(checkouts)]
    out = str(folder / "definitions")
    return ["-m", f"{PACKAGE}.generator_cli", "--keep-going", "--path", str(checkouts), "--out", out]


def run(name: str, checkouts: Path | None, folder: Path, timeout_s: float | None) -> Outcome:
    """Run a suite under coverage; its measurement and output are in the folder.

    A suite that takes longer than `timeout_s` is interrupted, and what it has reached counts.
    """
    rc = folder / f"{name}.rc"
    rc.write_text(_RC.format(source=ROOT / PACKAGE, data=folder / f"{name}.data"), encoding="utf-8")
    words = [sys.executable, "-m", "coverage", "run", f"--rcfile={rc}", *command(name, checkouts, folder)]
    paths = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    # Random examples are ours, so few of them are enough.
    few = {"ROSIDL_TEST_EXAMPLES": os.environ.get("ROSIDL_TEST_EXAMPLES", "0.02")}
    settings = {**os.environ, **few, "PYTHONPATH": paths, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    began = time.monotonic()
    with open(folder / f"{name}.log", "w+", encoding="utf-8", errors="replace") as log:
        process = subprocess.Popen(words, cwd=ROOT, env=settings, stdout=log, stderr=log, start_new_session=True)
        late = False
        try:
            process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            late = True
            os.killpg(process.pid, signal.SIGINT)
            try:
                process.wait(_GRACE_S)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        log.seek(0)
        output = log.read().partition("Traceback (most recent call last)")[0] if late else log.read()
        lines = [" ".join(line.strip(" =").split()) for line in output.splitlines() if line.strip()]
    seconds = time.monotonic() - began
    if not late and process.returncode not in (0, 1):  # 1: some tests or programs fail
        raise SystemExit(f"{name}: ended with {process.returncode}; see {folder / name}.log\n" + "\n".join(lines[-5:]))
    text = re.sub(r" in [\d.]+s.*", "", lines[-1] if lines else "no output")
    return Outcome(name, f"{progress(lines) or text}, then interrupted" if late else text, seconds)


def progress(lines: Iterable[str]) -> str:
    """Return how many tests have passed and failed, by the lines that pytest prints while it runs."""
    shown = re.compile(r"([.FEsxX]+)(?: +\[ *\d+%\]|!+ KeyboardInterrupt !+)?")
    found = "".join(match[1] for line in lines if (match := shown.fullmatch(line)))
    return f"{found.count('.')} passed, {found.count('F') + found.count('E')} failed" if found else ""


def measured(folder: Path, names: Iterable[str]) -> dict[Path, set[int]]:
    """Return the lines of each file that the suites have reached.

    One query for each measurement takes a hundredth of the time of `CoverageData.lines` for each file.
    """
    from coverage.numbits import numbits_to_nums

    found: dict[Path, set[int]] = {}
    for file in (file for name in names for file in sorted(folder.glob(f"{name}.data*"))):
        try:
            with closing(sqlite3.connect(f"{file.as_uri()}?mode=ro", uri=True)) as database:
                rows = database.execute("select path, numbits from line_bits join file on file.id = file_id").fetchall()
        except sqlite3.Error as error:  # of a process that was killed
            print(f"{file.name}: skipped: {error}", file=sys.stderr)
            continue
        for path, numbits in rows:
            found.setdefault(Path(path), set()).update(numbits_to_nums(numbits))
    return found


# --------------------------------------------------------------------------------------------- Functions of the product


class Function(NamedTuple):
    """Function of the product, with the lines of its statements without those of functions inside of it."""

    module: str
    name: str
    lines: frozenset[int]

    @property
    def room(self) -> str:
        return self.module.split("/")[0]

    @property
    def entry(self) -> str:
        return f"{self.module} {self.name}"


def functions(module: str, text: str, statements: Collection[int]) -> list[Function]:
    """Return the functions of a module that have statements."""
    found: list[Function] = []

    def visit(node: ast.AST, prefix: str) -> set[int]:
        """Return the lines of the statements in functions below a node."""
        inside: set[int] = set()
        for child in ast.iter_child_nodes(node):
            match child:
                case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                    nested = visit(child, f"{prefix}{name}.")
                    body = {line for one in child.body for line in range(one.lineno, (one.end_lineno or 0) + 1)}
                    if lines := (body & set(statements)) - nested:
                        found.append(Function(module, f"{prefix}{name}", frozenset(lines)))
                    inside |= body
                case ast.ClassDef(name=name):
                    inside |= visit(child, f"{prefix}{name}.")
                case _:
                    inside |= visit(child, prefix)
        return inside

    visit(ast.parse(text), "")
    return found


def product() -> Iterator[tuple[Path, list[Function], set[int]]]:
    """Yield the path, functions and statements of each module of the product."""
    from coverage import Coverage

    coverage = Coverage(data_file=None, config_file=False)
    for path in sorted((ROOT / PACKAGE).rglob("*.py")):
        if is_product(path.relative_to(ROOT).as_posix()):
            _, statements, _, _, _ = coverage.analysis2(str(path))
            name = path.relative_to(ROOT / PACKAGE).as_posix()
            yield path, functions(name, path.read_text(encoding="utf-8"), statements), set(statements)


def growth(recorded: Iterable[str], found: Iterable[str]) -> list[str]:
    """Return the entries that are found and not recorded; functions that moved within their room are recorded."""

    def key(entry: str) -> tuple[str, str]:
        module, _, name = entry.partition(" ")
        return module.split("/")[0], name

    left = Counter(map(key, recorded))
    new = []
    for entry in found:
        left[key(entry)] -= 1
        if left[key(entry)] < 0:
            new.append(entry)
    return new


# ------------------------------------------------------------------------------------------------------------ Reporting


def ranges(lines: Iterable[int]) -> str:
    """Return lines as ``3-5, 8``."""
    found: list[list[int]] = []
    for line in sorted(lines):
        if found and line == found[-1][1] + 1:
            found[-1][1] = line
        else:
            found.append([line, line])
    return ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in found)


def report(reached: dict[Path, set[int]], own: dict[Path, set[int]] | None) -> tuple[list[str], str]:
    """Print all unreached lines; return the entries of the unreached functions, and a summary."""
    rooms: dict[str, Counter[str]] = {}
    entries = []
    for path, found, statements in product():
        lines = reached.get(path, set())
        room = path.relative_to(ROOT / PACKAGE).parts[0].removesuffix(".py")
        counts = rooms.setdefault(room, Counter())
        counts["lines"] += len(statements)
        counts["reached"] += len(statements & lines)
        counts["functions"] += len(found)
        if own is not None:
            counts["none"] += len(statements - lines - own.get(path, set()))
        for one in found:
            if left := one.lines - lines:
                print(f"{one.entry}: {'all, ' if left == one.lines else ''}{ranges(left)}")
            if left == one.lines:
                entries.append(one.entry)
                counts["unreached"] += 1
    total: Counter[str] = sum(rooms.values(), Counter())
    columns = "  by no test" if own is not None else ""
    print(f"\n{'room':20} {'lines':>7} {'reached':>8} {'%':>4}  {'functions':>9} {'unreached':>9}{columns}")
    for room, counts in [*sorted(rooms.items()), ("all", total)]:
        percent = 100 * counts["reached"] // max(counts["lines"], 1)
        none = f"  {counts['none']:10}" if own is not None else ""
        numbers = (
            f"{counts['lines']:7} {counts['reached']:8} {percent:4}  {counts['functions']:9} {counts['unreached']:9}"
        )
        print(f"{room:20} {numbers}{none}")
    summary = (
        f"{total['reached']:,} of {total['lines']:,} lines are reached, "
        f"{total['unreached']:,} of {total['functions']:,} functions are not"
    )
    return sorted(set(entries)), summary


def record(outcomes: Sequence[Outcome], entries: Sequence[str], summary: str) -> str:
    """Return the text of the record."""
    head = [
        "Functions of the product that nothing written by other people reaches: our own tests alone, if any.",
        "Written by python tools/coverage_by_strangers.py --write; --check fails if a function is missing here.",
        f"{summary}. These suites were run:",
        *(f"- {one.suite}: {SUITES[one.suite].about}: {one.text}" for one in outcomes),
    ]
    return "".join(f"# {line}\n" for line in head) + "".join(f"{entry}\n" for entry in entries)


def read_record(text: str) -> tuple[set[str], list[str]]:
    """Return the suites and entries of a record."""
    suites = set(re.findall(r"^# - (\w+):", text, re.MULTILINE))
    return suites, [line for line in text.splitlines() if line and not line.startswith("#")]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("suites", nargs="*", metavar="SUITE", help=f"of {', '.join(SUITES)}; all without")
    for name, suite in SUITES.items():
        if suite.option:
            parser.add_argument(f"--{suite.option}", type=Path, metavar="CHECKOUTS", help=f"for {name}: {suite.about}")
    parser.add_argument("--minutes", type=float, help="time for all suites; each gets an equal part of what is left")
    parser.add_argument("--data", type=Path, metavar="FOLDER", help="measurements, which are stored and used again")
    parser.add_argument("--own", type=Path, nargs="*", metavar="FILE", help="measurements of our own tests")
    action = parser.add_mutually_exclusive_group()
    action.add_argument("--write", action="store_true", help=f"write {RECORD.relative_to(ROOT)}")
    action.add_argument("--check", action="store_true", help="fail if an unreached function is not recorded")
    given = parser.parse_args()
    if unknown := set(given.suites) - set(SUITES):
        parser.error(f"no such suite: {', '.join(sorted(unknown))}; there are {', '.join(SUITES)}")
    if (found := installed()) != ROOT / PACKAGE:
        parser.error(f"this environment imports {found}: pip install -e . in {ROOT}")
    with tempfile.TemporaryDirectory(prefix="strangers-") as temporary:
        folder = (given.data or Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        outcomes = _run_all(given, folder)
        reached = measured(folder, (one.suite for one in outcomes))
        own = None if given.own is None else _own(given.own)
        entries, summary = report(reached, own)
    print(f"\n{summary}")
    if given.write:
        RECORD.write_text(record(outcomes, entries, summary), encoding="utf-8", newline="\n")
    if not given.check:
        return 0
    suites, recorded = read_record(RECORD.read_text(encoding="utf-8"))
    if missing := suites - {one.suite for one in outcomes}:
        print(f"not run, but recorded: {', '.join(sorted(missing))}", file=sys.stderr)
        return 1
    new = growth(recorded, entries)
    print("".join(f"{entry}: only our own tests reach it, and the record does not list it\n" for entry in new), end="")
    return int(bool(new))


def installed() -> Path:
    """Return the folder of the package that programs import which get no PYTHONPATH."""
    words = [sys.executable, "-I", "-c", f"import {PACKAGE}; print({PACKAGE}.__file__)"]
    return Path(subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True).stdout.strip()).parent


def _run_all(given: argparse.Namespace, folder: Path) -> list[Outcome]:
    """Run the suites that are not in the folder, and return the outcomes of all."""
    ends = None if given.minutes is None else time.monotonic() + 60 * given.minutes
    wanted = []
    for name in given.suites or SUITES:
        checkouts = getattr(given, SUITES[name].option) if SUITES[name].option else None
        if SUITES[name].option and checkouts is None:
            print(f"{name}: skipped, without --{SUITES[name].option}", flush=True)
        else:
            wanted.append((name, checkouts))
    outcomes = []
    for number, (name, checkouts) in enumerate(wanted):
        stored = folder / f"{name}.json"
        if stored.exists():
            outcome = Outcome(*json.loads(stored.read_text(encoding="utf-8")))
        else:
            left = None if ends is None else max(ends - time.monotonic(), 1) / (len(wanted) - number)
            outcome = run(name, checkouts, folder, left)
            stored.write_text(json.dumps(outcome), encoding="utf-8")
        print(f"{name}: {outcome.text} ({outcome.seconds:.0f} s)", flush=True)
        outcomes.append(outcome)
    return outcomes


def _own(files: Iterable[Path]) -> dict[Path, set[int]]:
    found: dict[Path, set[int]] = {}
    for file in files:
        for path, lines in measured(file.parent, [file.name]).items():
            found.setdefault(path, set()).update(lines)
    return found


if __name__ == "__main__":
    sys.exit(main())
