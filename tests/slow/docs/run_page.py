"""Run all code of one page, in order: python run_page.py PAGE.md, in an empty folder.

A block with a title is a file. A Python block of a tab "Blocking" or "rclpy" is a program of its own, in a process,
until the page ends. Other Python blocks share their names and one event loop; `run(main)` lets `main` go on in the
background, so that a server of one block answers the client of the next. A line of a shell block that ends with
``# leave it running`` goes on until the page ends. Shell blocks run what they say to
``rosidl-py-gen`` and ``rosidl-py``, and to Python and pytest about files of the page. A text block says what the block
before it prints; behind a shell block it makes the examples named there, and commands that go on `_ENDLESS`, run
until the last one has printed it; then they end by themselves or by Ctrl-C.

With PAGE_TRANSPORT=memory nodes and commands of the page meet in this process, on a loop on which waiting takes no
time; only what `rosidl-py run` runs is a process of its own.
"""

from __future__ import annotations

import ast
import asyncio
import contextlib
import importlib
import inspect
import io
import itertools
import os
import re
import shlex
import signal
import sys
import types
from pathlib import Path
from socket import gethostname
from typing import TYPE_CHECKING, Any

from support.folders import ROOT
from support.markdown_pages import Block, blocks

import rosidl_py_gen.runtime as runtime
from rosidl_py_gen.ros_cli.topic import statistics
from rosidl_py_gen.runtime import MemoryTransport
from rosidl_py_gen.runtime.loop.virtual_time import VirtualTimeLoop
from rosidl_py_gen.runtime.node import context as node_context

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

_COMMANDS = {"rosidl-py-gen": ("-m", "rosidl_py_gen.generator_cli"), "rosidl-py": ("-m", "rosidl_py_gen.ros_cli")}
_ENDLESS = "# until Ctrl-C"
_LEAVE_RUNNING = "# leave it running"
_RUNNERS = {"Blocking": (), "rclpy": (*_COMMANDS["rosidl-py"], "run")}
"""Arguments of Python before the program of a block, by the title of its tab."""
TIMEOUT_S = float(os.environ.get("PAGE_PATIENCE_S", "90"))


class PageError(Exception):
    """The page is wrong, or its code is."""


class Page:
    """The state between two blocks."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.module = types.ModuleType("page")
        sys.modules["page"] = self.module
        self.programs: list[asyncio.Future[Any]] = []
        self.processes: list[tuple[asyncio.subprocess.Process, asyncio.Future[None], Block]] = []
        self.output = io.StringIO()
        self.world: Any = None
        """For pages in memory."""
        runtime.run = self.run  # type: ignore[assignment]
        runtime.spin = lambda *nodes: None

    def run(self, main: Callable[[], Coroutine[Any, Any, Any]]) -> None:
        self.programs.append(asyncio.ensure_future(main()))

    async def run_all(self) -> None:
        """Run the page; raises what went wrong."""
        found = blocks(self.path)
        for block, following in itertools.pairwise([*found, None]):
            try:
                await self.run_block(block)
                if block.language == "sh" and following and following.language == "text" and not following.title:
                    await self.run_examples(block.text, following.text.splitlines())
                for program in self.programs:
                    if program.done():
                        program.result()
            except Exception as error:
                reason = error if isinstance(error, PageError) else repr(error)
                raise PageError(f"{self.path.name}:{block.line}: {reason}") from error
        for process, reader, block in self.processes:
            ended = asyncio.ensure_future(process.wait())  # its output ends earlier
            await asyncio.wait([ended], timeout=5)  # a program that spins goes on
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGINT)
            await asyncio.wait_for(asyncio.gather(process.wait(), reader), TIMEOUT_S)
            if process.returncode not in (0, -signal.SIGINT):
                raise PageError(f"{self.path.name}:{block.line}: the program ended with {process.returncode}")
        for program in self.programs:
            program.cancel()
        results = await asyncio.gather(*self.programs, return_exceptions=True)
        for result in results:
            if isinstance(result, Exception):
                raise PageError(f"{self.path.name}: {result!r}") from result

    async def run_block(self, block: Block) -> None:
        """Do what the language and the title say."""
        if block.title:
            await self.write(block)
        elif block.language == "python":
            if not block.hidden:
                self.output = io.StringIO()
            if block.tab in _RUNNERS:
                await self.start(block)
            else:
                await self.execute(block)
        elif block.language == "sh":
            self.output = io.StringIO()
            for line in block.text.replace("\\\n", "").splitlines():
                await self.shell(line, block)
        elif block.language == "text":
            await self.expect(block.text.splitlines())
        else:
            raise PageError(f"nobody knows how to test {block.language!r}")

    async def execute(self, block: Block) -> None:
        """Run Python code that may await; line numbers are those of the page."""
        source = "\n" * (block.line - 1) + block.text
        code = compile(source, str(self.path), "exec", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)
        with contextlib.redirect_stdout(Tee(self)):
            result = eval(code, self.module.__dict__)
            if inspect.iscoroutine(result):
                await asyncio.wait_for(result, TIMEOUT_S)
            await asyncio.sleep(0)  # programs begin

    async def start(self, block: Block) -> None:
        """Run a block as a program beside the page's own."""
        path = Path(f"program_{block.line}.py")
        path.write_text(block.text, encoding="utf-8")
        command = [sys.executable, *_RUNNERS[block.tab], str(path)]
        environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
        process = await asyncio.create_subprocess_exec(*command, env=environment, stdout=asyncio.subprocess.PIPE)
        self.processes.append((process, asyncio.ensure_future(self.read(process)), block))

    async def write(self, block: Block) -> None:
        """Make the file; tests are run, modules imported."""
        path = Path(block.title)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(block.text, encoding="utf-8")
        if path.name.startswith("test_"):
            await self.command([sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", block.title])
        elif path.suffix == ".py":
            compile(block.text, block.title, "exec")

    async def shell(self, line: str, block: Block) -> None:
        """Run our commands; check that the names in them exist."""
        words = [os.path.expanduser(word) for word in shlex.split(line, comments=True)]
        for word in words:
            if re.match(r"(examples|bench|tests|docs)/", word) and not (ROOT / word).exists():
                raise PageError(f"{word} does not exist")
        if not words or line.endswith(_ENDLESS):
            return
        variables = dict(word.split("=", 1) for word in itertools.takewhile(lambda word: "=" in word, words))
        words = words[len(variables) :]
        if words and (words[0] in _COMMANDS or (words[0] == "python" and Path(words[1]).is_file())):
            program = [sys.executable, *_COMMANDS.get(words[0], ())]
            if line.endswith(_LEAVE_RUNNING):
                environment = {**os.environ, **variables, "PYTHONUNBUFFERED": "1"}
                process = await asyncio.create_subprocess_exec(
                    *program, *words[1:], env=environment, stdout=asyncio.subprocess.PIPE
                )
                self.processes.append((process, asyncio.ensure_future(self.read(process)), block))
                return
            await self.command([*program, *words[1:]], ends_with=int(line.endswith("# ends with 1")))

    async def command(self, command: list[str], ends_with: int = 0) -> None:
        """Run a program to its end, while the page's own programs go on."""
        process: Any
        if self.world is None or command[1:4] == [*_COMMANDS["rosidl-py"], "run"]:
            process = await asyncio.create_subprocess_exec(
                *command, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
            )
            output, _ = await asyncio.wait_for(process.communicate(), TIMEOUT_S)
        else:
            assert command[1:3] == [*_COMMANDS["rosidl-py"]], f"{command} needs a process"
            import pytest
            from support import in_process_commands

            process = in_process_commands.start(self.world, pytest.MonkeyPatch(), tuple(command[3:]), "")
            output = b"".join(await asyncio.wait_for(process.communicate(), TIMEOUT_S))
        self.output.write(output.decode())
        importlib.invalidate_caches()  # it may have made packages
        if process.returncode != ends_with:
            raise PageError(f"{shlex.join(command)} ended with {process.returncode}: {output.decode()}")

    async def run_examples(self, text: str, lines: list[str]) -> None:
        """Start the examples that a shell block names, until the last one has printed these lines."""
        found = re.findall(rf"^python examples/.*|^rosidl-py .*{_ENDLESS}$", text, re.MULTILINE)
        commands = [shlex.split(line, comments=True) for line in found]
        started = []
        for command in commands:
            output = asyncio.subprocess.PIPE if command is commands[-1] else asyncio.subprocess.DEVNULL
            known = _COMMANDS.get(command[0])
            program = [sys.executable, *(known or [str(ROOT / command[1])]), *command[1 if known else 2 :]]
            started.append(await asyncio.create_subprocess_exec(*program, stdout=output))
        if not started:
            return
        reader = asyncio.ensure_future(self.read(started[-1]))
        try:
            await self.expect(lines)
            await asyncio.wait([reader], timeout=1)
        finally:
            for process in started:
                with contextlib.suppress(ProcessLookupError):  # process.send_signal may take its return code away
                    if process.returncode is None:
                        os.kill(process.pid, signal.SIGINT)
            await asyncio.wait_for(asyncio.gather(reader, *(process.wait() for process in started)), TIMEOUT_S)
        if ended := [end for process in started if (end := process.returncode) not in (0, -signal.SIGINT)]:
            raise PageError(f"an example ended with {ended[0]}")

    async def read(self, process: asyncio.subprocess.Process) -> None:
        """Its output is the block's."""
        assert process.stdout is not None
        output = self.output
        async for line in process.stdout:
            output.write(line.decode())

    async def expect(self, lines: list[str]) -> None:
        """Wait until the block before has printed these lines first; ``…`` stands for anything, alone for any lines.

        Spaces and tabs at the end of lines do not count. In addresses, pages call this machine ``robot``.
        """
        lines = [line.replace("//robot:", f"//{gethostname()}:") for line in lines]
        patterns = [re.escape(line).replace("…", ".*") + "[ \\t]*\n" if line != "…" else "(?:.*\n)*?" for line in lines]
        pattern = "".join(patterns)
        for _ in range(int(TIMEOUT_S / 0.02)):
            if re.match(pattern, self.output.getvalue()):
                return
            await asyncio.sleep(0.02)
        raise PageError(f"expected {lines}, printed {self.output.getvalue()!r:.1000}")


class Tee(io.TextIOBase):
    """Output of the current block, also for programs that continue."""

    def __init__(self, page: Page) -> None:
        self.page = page

    def write(self, text: str) -> int:
        return self.page.output.write(text)


async def main(page: Page) -> None:
    """Run it."""
    sys.path[:0] = [os.getcwd(), str(Path("generated").resolve())]
    with contextlib.redirect_stdout(Tee(page)):
        await page.run_all()


if __name__ == "__main__":
    the_page = Page(Path(sys.argv.pop(1)).resolve())
    if os.environ.get("PAGE_TRANSPORT") == "memory":
        loop = VirtualTimeLoop(limit_s=100)
        the_page.world = types.SimpleNamespace(transport=MemoryTransport(loop.clocks), contexts=[])
        statistics.time_ns = loop.clocks.system_ns
        node_context.resolve_transport = lambda *_: the_page.world.transport  # type: ignore[assignment]
        loop.run(main(the_page))
    else:
        asyncio.run(main(the_page))
