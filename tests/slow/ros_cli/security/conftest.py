"""Fixtures with keystores in temporary folders and keystores made by SROS2."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from support.environments import require
from support.sros2_keystore import FOLDER, unpack

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@pytest.fixture(autouse=True)
def no_security_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ROS_SECURITY_KEYSTORE", "ROS_SECURITY_ENABLE", "ROS_DOMAIN_ID"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def golden() -> Path:
    """Folder of files made by SROS2."""
    return FOLDER


@pytest.fixture
def sros2_keystore(tmp_path: Path) -> Path:
    """A keystore that SROS2 made, with the enclaves /, /talker, /listener and /robot/arm."""
    return unpack(tmp_path / "sros2")


@pytest.fixture
def succeed(run_here: Any) -> Callable[..., str]:
    """Run a command of ``rosidl-py security`` that succeeds without notes, and return its output."""

    def run(*words: str) -> str:
        code, out, err = run_here("security", *words)
        assert (code, err) == (0, ""), err
        return out

    return run


@pytest.fixture
def fail(run_here: Any) -> Callable[..., str]:
    """Run a command that fails with exit code 1 and no output, and return its error."""

    def run(*words: str) -> str:
        code, out, err = run_here("security", *words)
        assert (code, out) == (1, ""), (out, err)
        assert "PRIVATE KEY" not in err or "expected PEM (-----BEGIN PRIVATE KEY-----)" in err
        return err

    return run


@pytest.fixture
def keystore(tmp_path: Path, succeed: Callable[..., str]) -> Path:
    """A new keystore without enclaves."""
    require("cryptography")
    root = tmp_path / "keystore"
    succeed("create_keystore", str(root))
    return root
