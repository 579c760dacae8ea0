"""All code of README.md and docs/ runs and prints the output on the page."""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from support.folders import ROOT
from support.machine_locks import lock
from support.markdown_pages import PAGES, blocks

if TYPE_CHECKING:
    from collections.abc import Callable

    RunPage = Callable[..., subprocess.CompletedProcess[str]]

WITH_CODE = [page for page in PAGES if blocks(page)]
OF_NETWORKS = {
    *("README", "diagnose", "from-rclpy", "launch", "network", "no-messages", "scripts-notebooks-guis", "zenoh"),
}


def transport_of(page: Path) -> str:
    """Memory, unless the page starts processes, is about the network or runs whole programs."""
    found = [block for block in blocks(page) if not block.title]
    lines = [line for block in found if block.language == "sh" for line in block.text.splitlines() if line.strip()]
    starts_others = any(re.match(r"python |rosidl-py-gen|.*# until Ctrl-C", line) for line in lines)
    is_test = any(Path(block.title).name.startswith("test_") for block in blocks(page))
    are_programs = any(block.tab in ("Blocking", "rclpy") for block in found)
    return "" if starts_others or is_test or are_programs or page.stem in OF_NETWORKS else "memory"


@contextlib.contextmanager
def ports_of(page: Path) -> Iterator[None]:
    """The ports of this machine and the domains that a page names, for this process alone."""
    text = page.read_text(encoding="utf-8")
    names = {f"port-{port}" for port in re.findall(r"(?:127\.0\.0\.1|localhost):(\d+)", text)}
    names |= {f"domain-{number}" for number in re.findall(r"ROS_DOMAIN_ID=(\d+) ", text)}
    locks = [lock(name, wait=True) for name in sorted(names)]
    try:
        yield
    finally:
        for descriptor in locks:
            if descriptor is not None:
                os.close(descriptor)


@pytest.mark.parametrize("page", WITH_CODE, ids=lambda page: str(page.relative_to(ROOT)))
def test_code_of_each_page_runs(page: Path, run_page: RunPage, request: pytest.FixtureRequest) -> None:
    everywhere = request.config.getoption("--all-transports")
    with ports_of(page):
        done = run_page(page, "" if everywhere else transport_of(page))
    assert (done.returncode, done.stdout) == (0, ""), done.stderr


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_shell_blocks_can_be_parsed(page: Path) -> None:
    for block in blocks(page):
        if block.language == "sh":
            done = subprocess.run(["bash", "-n"], input=block.text, text=True, capture_output=True)
            assert done.returncode == 0, f"{page.name}:{block.line}: {done.stderr}"


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("```python\n1 / 0\n```", "ZeroDivisionError"),
        ("```python\nprint(1)\n```\n\n```text\n2\n```", "expected ['2'], printed '1\\n'"),
        ("```python\nasync def main():\n    raise KeyError\n\n\nrun(main)\n```", "KeyError"),
        ("```sh\nrosidl-py-gen --filter no_such_package --out generated\n```", "no_such_package"),
        ("```sh\npython examples/no_such_example.py\n```", "no_such_example"),
        (
            "```sh\npython examples/service_chain.py\n```\n\n```text\nnever ready\n```",
            "expected ['never ready'], printed",
        ),
        ('```python title="test_one.py"\ndef test_one():\n    assert False\n```', "test_one.py ended with 1"),
        ("<!-- test\nassert False\n-->", "AssertionError"),
        (
            '=== "Blocking"\n\n    ```python\n    1 / 0\n    ```\n\n```sh\npython examples/messages.py\n```',
            "ended with 1",
        ),
    ],
)
def test_page_with_invalid_code_or_output_fails(
    text: str, error: str, run_page: RunPage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- test\nfrom rosidl_py_gen.runtime import run\n-->\n\n" + text + "\n", encoding="utf-8")
    if "never ready" in text:
        monkeypatch.setenv("PAGE_PATIENCE_S", "5")  # which pass
    done = run_page(page, transport_of(page))
    assert done.returncode == 1 and error in done.stderr, done.stderr
