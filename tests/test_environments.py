"""Environments for peers are made once, kept, and never half there (tests/support/environments.py)."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from support.environments import environment


def wheel(folder: Path, value: int) -> str:
    """A wheel with one module, so that no index is asked."""
    path = folder / f"peer_sample-{value}-py3-none-any.whl"
    info = f"peer_sample-{value}.dist-info"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("peer_sample.py", f"VALUE = {value}\n")
        archive.writestr(f"{info}/METADATA", f"Metadata-Version: 2.1\nName: peer-sample\nVersion: {value}\n")
        archive.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        archive.writestr(f"{info}/RECORD", f"peer_sample.py,,\n{info}/METADATA,,\n{info}/WHEEL,,\n{info}/RECORD,,\n")
    return str(path)


def value_in(python: Path | str) -> str:
    code = "import peer_sample; print(peer_sample.VALUE)"
    return subprocess.run([str(python), "-I", "-c", code], capture_output=True, text=True, check=True).stdout.strip()


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ROSIDL_TEST_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_an_environment_is_kept_and_another_list_makes_another_one(tmp_path: Path) -> None:
    one, two = wheel(tmp_path, 1), wheel(tmp_path, 2)
    first = environment("peer", [one])
    made = first.lstat().st_mtime_ns
    assert environment("peer", [one]) == first and first.lstat().st_mtime_ns == made
    second = environment("peer", [two])
    assert (value_in(first), value_in(second)) == ("1", "2")


def test_a_broken_environment_is_made_again(tmp_path: Path, cache: Path) -> None:
    python = environment("peer", [wheel(tmp_path, 1)])
    python.unlink()
    python.symlink_to(tmp_path / "removed")
    assert environment("peer", [wheel(tmp_path, 1)]) == python
    assert value_in(python) == "1"
    assert [one.name for one in cache.iterdir()] == [python.parent.parent.name]


def test_two_processes_that_start_at_once_end_with_one_environment(tmp_path: Path, cache: Path) -> None:
    code = f"import sys; sys.path[:0] = [{str(Path(__file__).parent)!r}]; import support.environments as it; "
    command = [sys.executable, "-c", code + f"print(it.environment('peer', [{wheel(tmp_path, 1)!r}]))"]
    running = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    found = {process.communicate(timeout=120)[0].strip() for process in running}
    assert [process.returncode for process in running] == [0, 0]
    assert len(found) == 1
    assert value_in(found.pop()) == "1"
    assert len(list(cache.iterdir())) == 1


def test_a_list_that_cannot_be_had_skips_with_the_words_of_pip(monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
    gone = str(cache / "gone-1-py3-none-any.whl")
    monkeypatch.delenv("ROSIDL_TEST_REQUIRE_PEERS", raising=False)
    with pytest.raises(pytest.skip.Exception, match="No such file or directory"):
        environment("peer", [gone])
    assert list(cache.iterdir()) == []
    monkeypatch.setenv("ROSIDL_TEST_REQUIRE_PEERS", "1")
    with pytest.raises(pytest.fail.Exception, match="No such file or directory"):
        environment("peer", [gone])
