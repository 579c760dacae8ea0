"""Programs that import the companions of rclpy run in processes of their own."""

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    folder: Path = tmp_path_factory.getbasetemp() / "companions"
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", str(folder))
