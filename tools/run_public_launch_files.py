"""Run public launch files with the original launch packages, from checkouts.

Run it as ``python tools/run_public_launch_files.py CHECKOUTS [TEXT ...]``.

CHECKOUTS has a folder owner/name for each repository that `public_launch_files.txt` beside this file names, and for
ros2/launch and ros2/launch_ros; ``--clone`` prints the commands that create it. Each launch file is
started with ``rosidl-py launch`` in the folder of its repository, which is only read. Once the nodes and topics that
the list expects are there, Ctrl-C is sent as a terminal does it: SIGINT for the whole process group. A file runs if no
process died before, all that is expected was there, and everything ended within 5 s. Nothing is fetched. Exit code 1
when a file does not run and the list has no reason for it.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from run_third_party_programs import argument_parser, chosen, environment, run_all

from rosidl_py_gen.runtime import Context, Node

LIST = Path(__file__).parent / "public_launch_files.txt"
LAUNCH = ("ros2/launch", "ros2/launch_ros")
_MINE = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "launch", "--missing=skip"]
_START_S, _QUIET_S, _END_S, _KILL_S = 40.0, 3.0, 5.0, 20.0
_MARK = "PUBLIC_LAUNCH_FILE"
"""Set for each run, so that processes that are left over are found wherever they went."""
_STARTED = re.compile(r"\[INFO\] \[(\S+)\]: process started with pid \[(\d+)\]")
_DIED = re.compile(r"\[ERROR\] \[(\S+)\]: process has died \[pid (\d+), exit code (-?\d+)")
_FAILED = re.compile(r"\[ERROR\] \[launch\]: Caught exception in launch.*?: (.*)")


@dataclass(frozen=True)
class LaunchFile:
    """A line of the list.

    Attributes:
        group: of the table that is printed.
        repository: owner/name.
        commit: of the repository, which was tried.
        paths: further repositories or folders below them, owner/name.
        place: the file in the repository.
        arguments: as ``name:=value``.
        expected: topics, with their first slash, and nodes, without it.
        reason: why it does not run; empty for one that has to.
    """

    group: str
    repository: str
    commit: str
    paths: tuple[str, ...]
    place: str
    arguments: tuple[str, ...]
    expected: tuple[str, ...]
    reason: str

    @property
    def name(self) -> str:
        return " ".join((self.repository, self.place, *self.arguments))

    def command(self, checkouts: Path) -> list[str]:
        own = () if "src" in Path(self.place).parts else (self.repository,)  # it would be cloned into a folder src
        paths = [f"--path={checkouts / one}" for one in (*own, *self.paths)]
        origin = [f"--launch-from={checkouts / one}" for one in LAUNCH]
        return [*_MINE, *origin, *paths, str(checkouts / self.repository / self.place), *self.arguments]


@dataclass
class Result:
    """Observations of a launch file; `problem` is empty if it runs."""

    file: LaunchFile
    processes: list[str] = field(default_factory=list)
    died: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    seen: set[str] = field(default_factory=set)
    end_s: float | None = None
    left: list[str] = field(default_factory=list)
    output: str = ""
    early: bool = False
    """It ended before Ctrl-C."""

    @property
    def problem(self) -> str:
        failed = _FAILED.search(self.output)
        if failed or not self.processes:
            lines = [line for line in self.output.splitlines() if line.strip()]
            return f"no process starts: {failed[1] if failed else lines[-1] if lines else 'no output'}"
        if self.died:
            return f"died: {'; '.join(self.died)}"
        if absent := [name for name in self.file.expected if name not in self.seen]:
            return f"not there: {' '.join(absent)}"
        if self.end_s is None or self.end_s > _END_S:
            return f"does not end within {_END_S:.0f} s of Ctrl-C"
        return f"left over: {' '.join(self.left)}" if self.left else ""


def listed(text: str) -> list[LaunchFile]:
    """``[group owner/name commit path...]`` begins a repository; lines: ``PLACE [ARGUMENTS] > NAMES [# reason]``."""
    found = []
    for line in filter(None, map(str.strip, text.splitlines())):
        if line.startswith("#"):
            continue
        if line.startswith("["):
            group, repository, commit, *paths = line.strip("[]").split()
            continue
        line, _, reason = line.partition(" # ")
        words, _, expected = line.partition(" > ")
        place, *rest = words.split()
        there = tuple(expected.split())
        found.append(LaunchFile(group, repository, commit, tuple(paths), place, tuple(rest), there, reason.strip()))
    return found


async def _try(checkouts: Path, file: LaunchFile, domains: Iterator[int]) -> Result:
    domain = next(domains)
    result, mark = Result(file), f"{os.getpid()}-{domain}-{time.monotonic_ns()}"
    with (
        tempfile.TemporaryDirectory(prefix="launch-") as logs,
        Context(domain_id=domain, discovery="localhost") as context,
    ):
        settings = {**environment(domain), "ROS_LOG_DIR": logs, "HOME": logs, _MARK: mark}
        process = await asyncio.create_subprocess_exec(
            *file.command(checkouts),
            cwd=checkouts / file.repository,
            env={**settings, "LINOROBOT2_BASE": "2wd", "XDG_CACHE_HOME": str(_cache())},
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            start_new_session=True,
        )
        reading = asyncio.ensure_future(_read(process, result))
        try:
            async with Node("public_launch_watch", context=context, enable_rosout=False) as node:
                await _look(node, result, reading)
            result.early = reading.done()
            result.died = _died(result.output)
            began = time.monotonic()
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGINT)
            with contextlib.suppress(asyncio.TimeoutError):
                await asyncio.wait_for(asyncio.shield(reading), _KILL_S)
                result.end_s = time.monotonic() - began
            result.left = [text for _, text in _marked(mark)]
        finally:
            for pid, _ in _marked(mark):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            await reading
    return result


def _cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


async def _read(process: asyncio.subprocess.Process, result: Result) -> None:
    assert process.stdout is not None
    while line := await process.stdout.readline():
        result.output += line.decode(errors="replace")
    await process.wait()


async def _look(node: Node, result: Result, ended: asyncio.Future[None]) -> None:
    """Wait until all expected endpoints exist and nothing has changed for a while, or until the timeout."""
    began = changed = time.monotonic()
    known: tuple[int, int] = (0, 0)
    while not ended.done() and time.monotonic() < began + _START_S:
        await asyncio.sleep(0.1)
        result.processes = [name for name, _ in _STARTED.findall(result.output)]
        nodes = {info.fully_qualified_name for info in node.get_nodes()} - {node.fully_qualified_name}
        result.seen |= {name.removeprefix("/") for name in nodes}
        result.seen |= {name for name, _ in node.get_topic_names_and_types()}
        now = len(result.seen), len(result.output)
        if now != known:
            known, changed = now, time.monotonic() if now[0] != known[0] else changed
        there = result.processes and result.file.expected and result.seen.issuperset(result.file.expected)
        if there and time.monotonic() > changed + _QUIET_S:
            break


def _died(output: str) -> list[str]:
    """Return each process that died, with the last line that it wrote."""
    found = []
    for name, _, code in _DIED.findall(output):
        own = [line for line in output.splitlines() if line.startswith(f"[{name}] ") and line.strip() != f"[{name}]"]
        found.append(f"{name} ({code}) {own[-1].partition('] ')[2][:160] if own else ''}".strip())
    return found


def _marked(mark: str) -> Iterator[tuple[int, str]]:
    """Return the processes of a run that are still alive."""
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if f"{_MARK}={mark}\0".encode() in (folder / "environ").read_bytes():
                yield int(folder.name), (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")


def _report(verbose: bool, result: Result) -> None:
    end = "" if result.end_s is None else f", {result.end_s:.1f} s to end"
    print(f"{result.file.name}: {result.problem or 'runs'} ({len(result.processes)} processes{end})", flush=True)
    if verbose:
        print("".join(f"    {name}\n" for name in sorted(result.seen)), result.output, sep="")


def _clone(files: list[LaunchFile]) -> None:
    commits = {one.repository: one.commit for one in files}
    others = (path for one in files for path in one.paths)
    names = [*commits, *LAUNCH, *("/".join(path.split("/")[:2]) for path in others)]
    for name in dict.fromkeys(names):
        print(
            f"git clone https://github.com/{name} {name} && git -C {name} checkout --quiet {commits.get(name, 'HEAD')}"
        )


def main() -> int:
    parser = argument_parser(__doc__, "files", LIST)
    parser.add_argument("--clone", action="store_true", help="print the commands that create CHECKOUTS")
    parser.add_argument("--verbose", action="store_true", help="print all nodes, topics and output")
    given = parser.parse_args()
    files = listed(given.list.read_text())
    if given.clone:
        _clone(files)
        return 0
    files, is_missing = chosen(files, given)
    results = run_all(files, given, partial(_try, given.checkouts.resolve()), partial(_report, given.verbose))
    print("\n| group | repositories | launch files | run |\n|---|---|---|---|")
    for group in [*dict.fromkeys(one.file.group for one in results), "all"]:
        those = [one for one in results if group in (one.file.group, "all")]
        runs = sum(not one.problem for one in those)
        print(f"| {group} | {len({one.file.repository for one in those})} | {len(those)} | {runs} |")
    for one in results:
        if one.problem:
            print(f"- {one.file.name}: {one.file.reason or one.problem[:200]}")
    return int(any(one.problem and not one.file.reason for one in results) or is_missing)


if __name__ == "__main__":
    sys.exit(main())
