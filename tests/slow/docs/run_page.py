"""Do what a page shows, in order and in an empty folder: python run_page.py PAGE.md.

- A block with the title of a file is written to this file; another block has to use it.
- Shell blocks are typed into bash, except the lines in `support.page_commands`. ``# ends with 1`` is the exit code.
- A line with ``# leave it running`` runs until the page ends. A line with ``# until Ctrl-C`` is interrupted when it has
  printed the text block below, or after a second.
- A Python block that calls `run`, `spin` or blocking methods is a program, which may run until the page ends.
- Other Python blocks are cells of one notebook: they share names and an event loop, which runs while commands do.
- A text block is what the block before it prints first. ``…`` stands for anything, alone on a line for any lines.
"""

from __future__ import annotations

import ast
import asyncio
import contextlib
import importlib
import inspect
import io
import os
import re
import signal
import sys
import types
from pathlib import Path
from socket import gethostname
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))  # the folder of `support`

from support.markdown_pages import Block, blocks
from support.page_commands import reason_not_to_type, typed

TIMEOUT_S = float(os.environ.get("PAGE_TIMEOUT_S", "30"))
"""Seconds that a command may take, or an output may need to appear."""
PAGE_LIMIT_S = 200.0
"""After this the page is given up and its processes are killed, before `run_page` of conftest.py gives up."""
_WAITS = b"; waiting for it\n"
"""End of a note that a command prints if it was faster than the program that the page has started before."""
_UNTIL_CTRL_C, _LEAVE_RUNNING = "# until Ctrl-C", "# leave it running"
_PROGRAM = re.compile(r"^(?:run|spin)\(|_sync\(|LoopRunner\(|install_import_hook\(", re.MULTILINE)
_TABS = {"asyncio": "python", "Blocking": "python", "rclpy": "rosidl-py run"}
_STATE = Path("..", "shell_state")
"""Variables and folder of the terminal, from block to block."""


def _is_program(block: Block) -> bool:
    try:
        compile(block.text, "block", "exec")
    except SyntaxError:  # `await` outside of functions
        return False
    return block.tab in _TABS or _PROGRAM.search(block.text) is not None


class PageError(Exception):
    """The page is wrong, or its code is."""


class Started:
    """Process of the page with its output so far."""

    def __init__(self, block: Block, process: asyncio.subprocess.Process) -> None:
        self.block = block
        self.process = process
        self.output = io.StringIO()
        self.reader = asyncio.ensure_future(self._read())

    async def _read(self) -> None:
        assert self.process.stdout is not None
        async for line in self.process.stdout:
            if not line.endswith(_WAITS):
                self.output.write(line.decode())

    async def first_line(self) -> None:
        """Wait until a program that prints has printed a line; raises if it never does."""
        if self.block.language != "python" or "print(" not in self.block.text:
            return
        end = asyncio.get_running_loop().time() + TIMEOUT_S
        while not self.output.getvalue():
            if self.reader.done() or asyncio.get_running_loop().time() > end:
                raise PageError("the program printed nothing")
            await asyncio.sleep(0.02)

    async def interrupt(self) -> None:
        """End the process as Ctrl-C does; raises if it ended in another way."""
        if self.process.returncode is not None:
            return await self.end()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGINT)
        await self.end((0, 1, 130, -signal.SIGINT))  # 1: a command that waited in vain
        if "Traceback" in (printed := self.output.getvalue()) and "KeyboardInterrupt" not in printed:
            raise PageError(f"printed {printed[-2000:]}")

    async def end(self, codes: tuple[int, ...] = (0,)) -> None:
        """Wait for the end of the process; raises if it ends with another code."""
        try:
            await asyncio.wait_for(asyncio.gather(self.process.wait(), self.reader), TIMEOUT_S)
        except asyncio.TimeoutError:
            raise PageError(f"still running after {TIMEOUT_S} s, printed {self.output.getvalue()[-2000:]}") from None
        if self.process.returncode not in codes:
            raise PageError(f"ended with {self.process.returncode}, printed {self.output.getvalue()[-2000:]}")


class Page:
    """The state between two blocks."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.cells = types.ModuleType("page")
        self.started: list[Started] = []
        self.output = io.StringIO()
        """Output of the last block."""
        sys.modules["page"] = self.cells

    async def run(self) -> None:
        """Run the page; raises what went wrong."""
        found = blocks(self.path)
        try:
            for block, below in zip(found, [*found[1:], None], strict=True):
                expected = below.text if below and below.language == "text" and not below.title else ""
                with self._place(block):
                    await self._run_block(block, expected, found)
            for one in self.started:
                with self._place(one.block):
                    await one.first_line()
            if self.started:  # some are programs that end
                await asyncio.wait([one.reader for one in self.started], timeout=2)
            for one in reversed(self.started):
                with self._place(one.block):
                    await one.interrupt()
        finally:
            for one in self.started:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(one.process.pid, signal.SIGKILL)

    @contextlib.contextmanager
    def _place(self, block: Block) -> Any:
        try:
            yield
        except Exception as error:
            reason = error if isinstance(error, PageError) else repr(error)
            raise PageError(f"{self.path.name}:{block.line}: {reason}") from error

    async def _run_block(self, block: Block, expected: str, found: list[Block]) -> None:
        if block.title and " " not in block.title and "." in block.title:
            self._write(block, found)
        elif block.language == "sh":
            await self._type(block, expected)
        elif block.language == "python":
            await (self._start_program(block) if _is_program(block) else self._run_cell(block))
        elif block.language != "text" or block.title:
            return
        if expected:
            await self._expect(expected.splitlines())

    def _write(self, block: Block, found: list[Block]) -> None:
        path = Path(block.title)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(block.text, encoding="utf-8")
        if path.suffix == ".py":
            compile(block.text, block.title, "exec")
            others = "\n".join(one.text for one in found if one is not block)
            if not path.stem.endswith("_test") and not re.search(rf"\b{path.stem}\b", others):
                raise PageError(f"no other block uses {path.name}")

    async def _type(self, block: Block, expected: str) -> None:
        group: list[str] = []
        self.output = io.StringIO()
        for line in block.text.replace("\\\n", "").splitlines():
            words, _, code = line.partition("# ends with ")
            command = typed(words.strip())
            if reason_not_to_type(command, block.text):
                continue
            if _LEAVE_RUNNING in line or _UNTIL_CTRL_C in line:
                await self._run_group(group)
                group = []
                await self._leave_running(block, command, expected, interrupt=_UNTIL_CTRL_C in line)
            else:
                group.append(f"code=0; {{ {command}\n}} || code=$?; [ $code = {code} ]" if code else command)
        await self._run_group(group)

    async def _run_group(self, lines: list[str]) -> None:
        if any(line.strip() for line in lines):
            self.output = io.StringIO()
            script = "\n".join(["set -e", *lines, f"{{ export -p; echo cd $PWD; }} > {_STATE.resolve()}"])
            done = Started(Block("sh", "", "", 0), await self._bash(script))
            try:
                await done.end()
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(done.process.pid, signal.SIGKILL)
            self.output.write(done.output.getvalue())
            importlib.invalidate_caches()  # it may have made packages

    async def _leave_running(self, block: Block, command: str, expected: str, interrupt: bool) -> None:
        one = Started(block, await self._bash(f"exec {command}"))
        self.started.append(one)
        self.output = one.output
        if not interrupt:
            return
        if expected:
            await self._expect(expected.splitlines())
        else:
            await asyncio.sleep(1)
        self.started.remove(one)
        await one.interrupt()

    async def _bash(self, script: str) -> asyncio.subprocess.Process:
        state = f". {_STATE.resolve()}\n" if _STATE.exists() else ""
        return await asyncio.create_subprocess_exec(
            *("bash", "-c", state + script),
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            start_new_session=True,
        )

    async def _start_program(self, block: Block) -> None:
        path = Path(f"program_{block.line}.py")
        path.write_text(block.text, encoding="utf-8")
        without_packages = "PYTHONPATH= " if "import_hook(" in block.text else ""
        one = Started(block, await self._bash(f"{without_packages}exec {_TABS.get(block.tab, 'python')} {path}"))
        self.started.append(one)
        self.output = one.output

    async def _run_cell(self, block: Block) -> None:
        self.output = io.StringIO()
        source = "\n" * (block.line - 1) + block.text
        code = compile(source, str(self.path), "exec", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)
        result = eval(code, self.cells.__dict__)
        if inspect.iscoroutine(result):
            await asyncio.wait_for(result, TIMEOUT_S)

    async def _expect(self, lines: list[str]) -> None:
        """Wait for lines. Spaces at their ends do not count. In addresses, pages call this machine ``robot``."""
        lines = [line.replace("//robot:", f"//{gethostname()}:") for line in lines]
        patterns = [re.escape(line).replace("…", ".*") + "[ \\t]*\n" if line != "…" else "(?:.*\n)*?" for line in lines]
        running = self.started[-1] if self.started and self.started[-1].output is self.output else None
        end = asyncio.get_running_loop().time() + (TIMEOUT_S if running else 10)
        while not re.match("".join(patterns), self.output.getvalue()):
            if asyncio.get_running_loop().time() > end or (running and running.reader.done()):
                raise PageError(f"expected {lines}, printed {self.output.getvalue()!r:.3000}")
            await asyncio.sleep(0.02)


class Tee(io.TextIOBase):
    """Output of the cells, which is the current block's."""

    def __init__(self, page: Page) -> None:
        self.page = page

    def write(self, text: str) -> int:
        return self.page.output.write(text)


async def main(page: Page) -> None:
    """Run it with a stand-in for the output."""
    sys.path.insert(0, os.getcwd())
    with contextlib.redirect_stdout(Tee(page)):
        await asyncio.wait_for(page.run(), PAGE_LIMIT_S)


if __name__ == "__main__":
    asyncio.run(main(Page(Path(sys.argv.pop(1)).resolve())))
