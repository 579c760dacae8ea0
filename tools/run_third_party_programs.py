"""Run third-party programs under our rclpy, from their sources.

Run it as ``python tools/run_third_party_programs.py CHECKOUTS [TEXT ...]``.

CHECKOUTS has a folder owner/name for each repository that `third_party_programs.txt` beside this file names; it is only
read, and programs run with their folder of it as working directory. Each is started with ``rosidl-py run``, gets
traffic for whatever it shows in the graph (messages for its subscriptions, a server for its clients, calls of its
services, goals for its actions), and is interrupted once nothing new comes up. With ``--real PYTHON``, one that has a
real rclpy, the same is done with that, and what differs is told. ``rosidl-py run --check`` is asked as well. Nothing is
fetched. Exit code 1 when a program does not run and the list has no reason for it.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import itertools
import json
import os
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from support.program_observer import Seen, watch

from rosidl_py_gen.prefix.executables import of_sources
from rosidl_py_gen.runtime import Context, Node

T = TypeVar("T")
R = TypeVar("R")
LIST = Path(__file__).parent / "third_party_programs.txt"
DOMAINS = 6
"""Domains that a worker uses in turn, so that the graph forgets killed programs."""
_MINE = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "run"]
_ENDS = (
    "KeyboardInterrupt",
    "ExternalShutdownException",
    "rcl_shutdown already called",
    "context is already shut down",
    "context is shut down",
)
"""Last lines of programs that were interrupted and did not catch that; the same under real rclpy."""
_CALL = "import sys, importlib as i; sys.argv = sys.argv[1:]; sys.exit(getattr(i.import_module({!r}), {!r})())"


@dataclass(frozen=True)
class Program:
    """A line of the list.

    Attributes:
        group: of the table that is printed.
        repository: owner/name.
        place: a file, or the folder of a package, in the repository.
        words: the executable, if `place` is a folder, and arguments.
        paths: folders with further packages, owner/name or below that.
        reason: why it does not run; empty for one that has to.
        beside: executables of its repository that run at the same time.
    """

    group: str
    repository: str
    place: str
    words: tuple[str, ...]
    paths: tuple[str, ...]
    reason: str
    beside: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        return " ".join((self.repository, self.place, *self.words))

    def mine(self, checkouts: Path, *options: str) -> list[str]:
        place = checkouts / self.repository / self.place
        paths = [f"--path={one}" for name in self.paths for one in _packages(checkouts, name)]
        file = place.is_file()
        return [*_MINE, *options, *paths, str(place) if file else _package(place), *self.words]

    def real(self, checkouts: Path, python: str) -> list[str]:
        place = checkouts / self.repository / self.place
        if place.is_file():
            return [python, str(place), *self.words]
        found = of_sources(place)[self.words[0]]
        if found.file is not None:
            return [python, str(found.file), *self.words[1:]]
        return [python, "-c", _CALL.format(found.module, found.function), *self.words]


def _package(folder: Path) -> str:
    text = (folder / "package.xml").read_text()
    return text.partition("<name>")[2].partition("</name>")[0].strip()


def listed(text: str) -> list[Program]:
    """``[group owner/name path...]`` begins a repository; its lines are ``PLACE [WORDS] [& BESIDE] [# reason]``."""
    found = []
    for line in filter(None, map(str.strip, text.splitlines())):
        if line.startswith("#"):
            continue
        if line.startswith("["):
            group, repository, *paths = line.strip("[]").split()
            continue
        line, _, reason = line.partition(" # ")
        words, _, beside = line.partition(" & ")
        place, *rest = words.split()
        program = Program(group, repository, place, tuple(rest), tuple(paths), reason.strip(), tuple(beside.split()))
        found.append(program)
    return found


@dataclass
class Result:
    """Result of a program; `problem` is empty if it runs."""

    program: Program
    mine: Seen
    told: str
    """By ``--check``; empty for nothing."""
    real: Seen | None = None
    problem: str = ""
    differs: list[str] = field(default_factory=list)
    ends: list[str] = field(default_factory=list)
    """Difference in its end after SIGINT."""


async def _try(checkouts: Path, python: str | None, program: Program, domains: Iterator[int]) -> Result:
    domain = next(domains)
    cwd, base = checkouts / program.repository, environment(domain)
    paths = _interfaces(checkouts, (program.repository, *program.paths))
    told = await _check(program.mine(checkouts, "--check"), cwd, base)
    async with contextlib.AsyncExitStack() as stack:
        for one in program.beside:
            other = replace(program, place=one.split(":")[0], words=tuple(one.split(":")[1:]))
            await stack.enter_async_context(_running(other.mine(checkouts), cwd, base))
        mine = await watch(program.mine(checkouts), cwd, base, domain, paths)
    result = Result(program, mine, told, problem=_problem(mine))
    if python is not None:
        place = checkouts / program.repository / program.place
        there = place.parent if place.is_file() else next(iter(of_sources(place).values())).folder
        domain = next(domains)
        settings = {**environment(domain), "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp", "PYTHONPATH": str(there)}
        real = await watch(program.real(checkouts, python), cwd, settings, domain, paths)
        if "ModuleNotFoundError" not in real.last and "ImportError" not in real.last:
            result.real = real
            result.differs, result.ends = _differences(real, mine), _ends(real, mine)
            if not (real.interrupted and mine.interrupted):
                result.differs, result.ends = result.differs + result.ends, []
            if result.problem and not result.differs + result.ends:
                result.problem = f"as under real rclpy: {result.problem}"
    return result


@contextlib.asynccontextmanager
async def _running(command: list[str], cwd: Path, environment: dict[str, str]) -> AsyncIterator[None]:
    """Run a program in the background: wait for its node, and stop it at the end of the block."""
    null = asyncio.subprocess.DEVNULL
    process = await asyncio.create_subprocess_exec(*command, cwd=cwd, env=environment, stdout=null, stderr=null)
    try:
        with Context(domain_id=int(environment["ROS_DOMAIN_ID"]), discovery="localhost") as context:
            async with Node("others_beside", context=context, enable_rosout=False) as node:
                while len(node.get_nodes()) < 2 and process.returncode is None:
                    await asyncio.sleep(0.1)
        yield
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()


def _packages(checkouts: Path, path: str) -> list[str]:
    """Return the packages of a repository that have definitions, or the repository itself, a Python package."""
    return _interfaces(checkouts, (path,)) or [str(checkouts / path)]


def _interfaces(checkouts: Path, repositories: tuple[str, ...]) -> list[str]:
    """The packages of these repositories that have definitions."""
    kinds = ("msg", "srv", "action")
    files = (file for one in repositories for file in (checkouts / one).rglob("package.xml"))
    return sorted(str(file.parent) for file in files if any((file.parent / kind).is_dir() for kind in kinds))


def environment(domain: int) -> dict[str, str]:
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("ROS_", "RCUTILS_", "PYTHON"))}
    ours = {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "MPLBACKEND": "agg"}
    robot = {"TURTLEBOT3_MODEL": "burger", "LDS_MODEL": "LDS-01", "ROS_DISTRO": "jazzy"}
    return {
        **kept,
        **ours,
        **robot,
        "PYTHONUNBUFFERED": "1",
        "PYTHONDONTWRITEBYTECODE": "1",
        "QT_QPA_PLATFORM": "offscreen",
    }


async def _check(command: list[str], cwd: Path, environment: dict[str, str]) -> str:
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(*command, cwd=cwd, env=environment, stdout=pipe, stderr=pipe)
    out, error = await process.communicate()
    return "" if process.returncode == 0 else (out + error).decode(errors="replace").strip()


def _problem(seen: Seen) -> str:
    if seen.code is None:
        return "does not end on SIGINT"
    if not seen.interrupted and seen.code:
        return f"ended with {seen.code}: {seen.last}"
    if "Traceback (most recent call last)" in seen.errors and not any(end in seen.last for end in _ENDS):
        return f"traceback: {seen.last}"
    if seen.interrupted and not seen.nodes:
        return "no node"
    return ""


def _differences(real: Seen, mine: Seen) -> list[str]:
    found = []
    for name in ("nodes", "endpoints", "published", "answered", "interrupted"):
        one, two = getattr(real, name), getattr(mine, name)
        if isinstance(one, list):
            gone, new = Counter(map(str, one)) - Counter(map(str, two)), Counter(map(str, two)) - Counter(map(str, one))
            found += [f"{name}: only real {text}" for text in gone] + [f"{name}: only ours {text}" for text in new]
        elif one != two:
            found.append(f"{name}: real {one}, ours {two}")
    return found


def _ends(real: Seen, mine: Seen) -> list[str]:
    found = [] if real.code == mine.code else [f"code: real {real.code}, ours {mine.code}"]
    first, second = (text.last.split(":")[0] for text in (real, mine))
    if first != second and "Traceback" in real.errors + mine.errors:
        found.append(f"last line: real {real.last}, ours {mine.last}")
    return found


def _report(result: Result) -> None:
    how = "differs" if result.differs else "the same but for its end" if result.ends else "the same"
    same = "" if result.real is None else f" (real: {how})"
    print(f"{result.program.name}: {result.problem or 'runs'}{same}", flush=True)
    for line in result.differs + result.ends:
        print(f"    {line[:300]}")
    if bool(result.told) != ("No module" in result.mine.errors or "cannot import" in result.mine.errors):
        print(f"    --check: {(result.told or 'nothing')[:600]}")


# --- what `run_public_launch_files` needs, too ------------------------------------------------------------------------


def run_all(
    items: Sequence[T],
    given: argparse.Namespace,
    run: Callable[[T, Iterator[int]], Awaitable[R]],
    report: Callable[[R], None],
) -> list[R]:
    """Run items, some at once, each in other domains than the ones before it."""
    # A shell has background commands ignore SIGINT, and so would all processes that are started.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    waiting, results = list(enumerate(items)), {}

    async def work(first: int) -> None:
        domains = itertools.cycle(range(first, first + DOMAINS))
        while waiting:
            number, item = waiting.pop(0)
            results[number] = await run(item, domains)
            report(results[number])

    async def main() -> None:
        await asyncio.gather(*(work(given.domain + number * DOMAINS) for number in range(given.jobs)))

    asyncio.run(main())
    return [results[number] for number in sorted(results)]


def argument_parser(description: str, things: str, default: Path) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("checkouts", type=Path, help="a folder with a folder owner/name for each repository")
    parser.add_argument("only", nargs="*", help=f"run those {things} that have one of these texts in their line")
    parser.add_argument("--list", type=Path, default=default, help=f"another list of {things}")
    parser.add_argument("--jobs", type=int, default=1, help=f"so many {things} at once, each in a domain of its own")
    parser.add_argument("--domain", type=int, default=1, help=f"the first of {DOMAINS} domains for each job")
    return parser


def chosen(items: Iterable[Any], given: argparse.Namespace) -> tuple[list[Any], bool]:
    """Return the items that are asked for and there, and whether the repository of one is missing, which is printed."""
    items = [one for one in items if not given.only or any(text in f"{one.group} {one.name}" for text in given.only)]
    missing = {one.repository for one in items if not (given.checkouts / one.repository).is_dir()}
    if missing:
        print(f"not in {given.checkouts}: {', '.join(sorted(missing))}", file=sys.stderr)
    return [one for one in items if one.repository not in missing], bool(missing)


def main() -> int:
    parser = argument_parser(__doc__, "programs", LIST)
    parser.add_argument("--real", help="a Python that has a real rclpy")
    parser.add_argument("--json", type=Path, help="a file for all that was seen")
    given = parser.parse_args()
    if given.domain + given.jobs * DOMAINS > 232:
        parser.error(f"{given.jobs} jobs need {given.jobs * DOMAINS} domains up to 232")
    programs, is_missing = chosen(listed(given.list.read_text()), given)
    with tempfile.TemporaryDirectory(prefix="others-") as logs:
        os.environ["ROS_LOG_DIR"] = logs
        results = run_all(programs, given, partial(_try, given.checkouts.resolve(), given.real), _report)
    if given.json:
        given.json.write_text(json.dumps([asdict(replace(one)) for one in results], indent=1, default=str))
    print("\n| group | programs | run | as under real rclpy | but for their end |\n|---|---|---|---|---|")
    for group in [*dict.fromkeys(one.program.group for one in results), "all"]:
        those = [one for one in results if group in (one.program.group, "all")]
        compared = [one for one in those if one.real is not None and not one.differs]
        same, known = sum(not one.ends for one in compared), sum(one.real is not None for one in those)
        runs = sum(not one.problem for one in those)
        print(f"| {group} | {len(those)} | {runs} | {same} of {known} | {len(compared) - same} |")
    for one in results:
        if one.problem:
            print(f"- {one.program.name}: {one.program.reason or one.problem[:200]}")
    return int(any(one.problem and not one.program.reason for one in results) or is_missing)


if __name__ == "__main__":
    sys.exit(main())
