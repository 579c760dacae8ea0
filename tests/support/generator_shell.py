"""Runs `rosidl-py-gen` in this process, in a folder of its own and without the caller's environment."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from rosidl_py_gen.generator_cli import main


@dataclass(frozen=True)
class Answer:
    """Exit code and output of a command."""

    code: Any
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


@dataclass(frozen=True)
class Shell:
    """Calls commands in `folder`."""

    folder: Path
    capsys: pytest.CaptureFixture[str]

    def __call__(self, *arguments: str) -> Answer:
        self.capsys.readouterr()
        code: Any = 0
        try:
            main([*arguments])
        except SystemExit as end:
            code = end.code
        return Answer(code, *self.capsys.readouterr())

    def written(self) -> list[str]:
        return sorted(str(path.relative_to(self.folder)) for path in self.folder.rglob("*") if path.is_file())


@pytest.fixture
def shell(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Shell:
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    for name in ("AMENT_PREFIX_PATH", "IDL_PACKAGE_FILTER"):
        monkeypatch.delenv(name, raising=False)
    return Shell(folder, capsys)
