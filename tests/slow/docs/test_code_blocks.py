"""Every block of README.md and docs/ runs as printed, and prints the output on the page."""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from support.docs_pictures import update_picture
from support.folders import ROOT
from support.machine_locks import lock
from support.markdown_pages import PAGES, blocks
from support.page_commands import REASONS, reason_not_to_type

if TYPE_CHECKING:
    from collections.abc import Callable

    RunPage = Callable[[Path], subprocess.CompletedProcess[str]]

WITH_CODE = [page for page in PAGES if blocks(page) and page.parent.name != "internals"]


@contextlib.contextmanager
def ports_of(page: Path) -> Iterator[None]:
    """The ports of this machine and the domains that a page names, for this process alone."""
    text = page.read_text(encoding="utf-8")
    names = {f"port-{port}" for port in re.findall(r"(?:127\.0\.0\.1|localhost):(\d+)", text)}
    names |= {f"domain-{number}" for number in re.findall(r"(?:--domain |Context\()(\d+)", text)}
    locks = [lock(name, wait=True) for name in sorted(names)]
    try:
        yield
    finally:
        for descriptor in locks:
            if descriptor is not None:
                os.close(descriptor)


@pytest.mark.parametrize("page", WITH_CODE, ids=lambda page: str(page.relative_to(ROOT)))
def test_page_runs_as_printed(page: Path, run_page: RunPage, tmp_path: Path) -> None:
    with ports_of(page):
        done = run_page(page)
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    if page.stem == "read-a-recording":
        update_picture("drive.png", (tmp_path / "home/drive.png").read_bytes())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_shell_blocks_can_be_parsed(page: Path) -> None:
    for block in blocks(page):
        if block.language == "sh":
            done = subprocess.run(["bash", "-n"], input=block.text, text=True, capture_output=True)
            assert done.returncode == 0, f"{page.name}:{block.line}: {done.stderr}"


LEFT_RUNNING = """\
```sh
bash -c 'trap "touch ended" EXIT; exit 2'  # leave it running
while [ ! -e ended ]; do sleep 0.1; done
```"""
"""The page does not end before the program does, which takes seconds on a busy machine."""


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("```python\n1 / 0\n```", "ZeroDivisionError"),
        ("```python\nprint(1)\n```\n\n```text\n2\n```", "expected ['2'], printed '1\\n'"),
        ("```sh\nexit 3\n```", "ended with 3"),
        ("```sh\ntrue  # ends with 1\n```", "ended with"),
        ("```sh\necho one  # leave it running\n```\n\n```text\ntwo\n```", "expected ['two'], printed 'one"),
        (LEFT_RUNNING, "ended with 2"),
        ('```python title="one.py"\nprint(1)\n```', "no other block uses one.py"),
        ('=== "Blocking"\n\n    ```python\n    print(1)\n    1 / 0\n    ```', "ZeroDivisionError"),
        ('=== "Blocking"\n\n    ```python\n    if 0: print(1)\n    ```', "the program printed nothing"),
    ],
)
def test_page_with_invalid_code_or_output_fails(text: str, error: str, run_page: RunPage, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(text + "\n", encoding="utf-8")
    done = run_page(page)
    assert done.returncode == 1 and error in done.stderr, done.stderr


def test_every_line_that_is_not_typed_is_on_a_page() -> None:
    shown = [(line, block.text) for page in WITH_CODE for block in blocks(page) for line in block.text.splitlines()]
    used = {reason_not_to_type(line, text) for line, text in shown} - {""}
    assert used == set(REASONS)
