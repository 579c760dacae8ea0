"""Settings that all tests share: which tests are core tests, nodes on the loopback interface only, Hypothesis without
deadlines, and Ctrl-C as in a terminal.

Core tests are those of `core/` that run in this process, in memory or on DDS: all that are neither marked `slow` or
`needs` nor run on Zenoh; of a test with very many cases only a part. ``pytest tests/core`` and ``pytest -m core`` run
them, with a tenth of the random examples.
"""

from __future__ import annotations

import compileall
import gc
import importlib
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import HealthCheck, is_hypothesis_test, settings
from support.environments import cache_folder, require
from support.example_counts import examples
from support.local_network import only_loopback
from support.without_message_packages import restart_without_message_packages
from support.worlds import dds, memory, network, pytest_pyfunc_call, world

from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.runtime.transport.cyclone import library

CORE = Path(__file__).resolve().parent / "core"
MANY_CASES = 40
"""Number of cases of a test that are core, evenly spread; a tenth of them if that is more."""
__all__ = ["dds", "memory", "network", "only_loopback", "pytest_pyfunc_call", "world"]

NOT_EVERYWHERE = {
    "libddsc": r"cyclonedds|rosidl_py_gen\.runtime\.transport\.cyclone",
    "fcntl": "fcntl|private_network",
    "resource": "resource",
}
"""Modules that some machines do not have, and regular expressions for imports that need them."""
ONLY_IN_TEST_ALL = {
    "IPython", "botocore", "cryptography", "dask", "distributed", "duckdb", "flask", "fsspec", "griffe", "hatchling",
    "ipykernel", "jupyter_client", "loky", "matplotlib", "mcap_ros2", "moto", "mypy", "pandas", "plotext", "polars",
    "pyarrow", "pycdr2", "rosbags", "ruff", "s3fs", "trustme", "upath", "uv", "uvloop", "xacro",
}  # fmt: skip
"""Modules that the extra `test-all` installs and `test` does not."""
_SHRINKING_S = 900
"""Timeout of a random test: Hypothesis takes up to 300 s to shrink a failing example, and reports it afterwards."""
_MEMORY = Path("/dev/shm")
_ENOUGH_BYTES = 4 << 30


def is_there(name: str) -> bool:
    return library.is_found() if name == "libddsc" else find_spec(name) is not None


@pytest.hookimpl(tryfirst=True)  # before hypothesis looks at --hypothesis-profile
def pytest_configure(config: pytest.Config) -> None:
    if "PYTEST_XDIST_WORKER" not in os.environ:
        restart_without_message_packages(config)
    importlib.import_module("support.generated_packages")  # importable before tests are collected
    if not config.getoption("-m") and {(config.invocation_params.dir / one).resolve() for one in config.args} == {CORE}:
        config.option.markexpr = "core"
    if _runs_core(config):
        os.environ.setdefault("ROSIDL_TEST_EXAMPLES", "0.1")
        # Workers return freed memory to the system; else each would keep 80 MB of it.
        for name, value in {"ARENA_MAX": 2, "TRIM_THRESHOLD_": 1 << 17, "MMAP_THRESHOLD_": 1 << 17}.items():
            os.environ.setdefault(f"MALLOC_{name}", str(value))
        config.pluginmanager.register(_OnlyCoreFolder())
    sys.meta_path.insert(0, _WithoutAssertions())
    if "PYTEST_XDIST_WORKER" not in os.environ:
        if sys.dont_write_bytecode:  # else the first of hundreds of processes does it
            compileall.compile_dir(config.rootpath / "rosidl_py_gen", quiet=2)
        if not Path(".hypothesis", "unicode_data").exists():  # 200 MB: too much for a worker with all tests
            code = "from hypothesis import strategies; strategies.text().validate()"
            subprocess.run([sys.executable, "-c", code], check=True)
        if _MEMORY.is_dir() and os.access(_MEMORY, os.W_OK) and shutil.disk_usage(_MEMORY).free > _ENOUGH_BYTES:
            os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(_MEMORY))
    # Of several mypys the first reads the stubs of numpy; two at a time may not share what they have read.
    os.environ.setdefault("MYPY_CACHE_DIR", f"{cache_folder()}/mypy-{os.environ.get('PYTEST_XDIST_WORKER', 'alone')}")
    os.environ.setdefault("PYTHONFAULTHANDLER", "1")  # a process that crashes says where
    if config.getoption("--hypothesis-seed") is None:
        config.option.hypothesis_seed = os.environ.get("ROSIDL_TEST_SEED") or None
    settings.register_profile(
        "project",
        max_examples=examples(100),
        deadline=None,
        print_blob=True,
        suppress_health_check=[HealthCheck.too_slow],
        # Where peers are required, the same examples every time unless a seed is given: CI gives one and prints it.
        # Everybody else tries new ones.
        derandomize="ROSIDL_TEST_REQUIRE_PEERS" in os.environ and not config.getoption("--hypothesis-seed"),
    )
    settings.load_profile("project")
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


class _WithoutAssertions:
    """Loads the package as Python does: pytest would rewrite the assertions of its hundreds of modules in every run."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        return PathFinder.find_spec(name, path, target) if name.startswith("rosidl_py_gen.") else None


def pytest_collection_finish() -> None:
    gc.collect()
    gc.freeze()


class _OnlyCoreFolder:
    """Skip collecting other folders, to save import time."""

    def pytest_ignore_collect(self, collection_path: Path) -> bool | None:
        is_above = collection_path in CORE.parents
        return None if is_above or collection_path.is_relative_to(CORE) else True


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Leave out the files that import at their head what this machine cannot have, and folders whose conftest does."""
    missing = [imports for name, imports in NOT_EVERYWHERE.items() if not is_there(name)]
    file = collection_path / "conftest.py" if collection_path.is_dir() else collection_path
    if not missing or file.suffix != ".py" or not file.exists():
        return None
    found = re.search(rf"^(from|import) ({'|'.join(missing)})\b", file.read_text(encoding="utf-8"), re.MULTILINE)
    return True if found else None


class _ModuleOfTests(pytest.Module):
    """Skipped with the reason if it imports a module that only the extra `test-all` installs."""

    def _getobj(self) -> ModuleType:
        try:
            return super()._getobj()  # type: ignore[no-any-return]
        except self.CollectError as error:
            cause = error.__cause__
            if isinstance(cause, ModuleNotFoundError):
                name = str(cause.name).partition(".")[0]
                if sys.version_info[:2] >= Extra.WITHOUT_WHEELS.get(name, (4, 0)):
                    pytest.skip(str(Extra.missing_error(cause)), allow_module_level=True)
                # A core test may not need such a module: CI runs core tests in an environment without them only.
                is_required = "ROSIDL_TEST_REQUIRE_PEERS" in os.environ or self.path.is_relative_to(CORE)
                if name in ONLY_IN_TEST_ALL and not is_required:
                    pytest.skip(_needs(name), allow_module_level=True)
            raise


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module:
    return _ModuleOfTests.from_parent(parent, path=module_path)  # type: ignore[no-any-return]


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip tests marked `needs` for a module that is not installed, and tests on DDS without a libddsc."""
    if item.get_closest_marker("dds") is not None and not is_there("libddsc"):
        pytest.skip("needs libddsc")
    for mark in item.iter_markers("needs"):
        for name in mark.args:
            require(name)


def _needs(module: str) -> str:
    return f"needs {module}, which pip install -e '.[test-all]' brings"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--fuzz-rounds", type=int, default=examples(100_000), help="inputs the codec fuzzers try")
    parser.addoption(
        "--all-transports", action="store_true", help="run tests with a world on DDS and Zenoh, too, all of them"
    )


def _runs_core(config: pytest.Config) -> bool:
    return str(config.getoption("-m")).partition(" ")[0] == "core"  # "core and not dds" is a part of them


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the core tests `core`, and tests on a transport with its name."""
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        if is_hypothesis_test(getattr(item, "obj", None)):
            item.add_marker(pytest.mark.timeout(_SHRINKING_S))
        fixtures = getattr(item, "fixturenames", ())
        parameters = getattr(getattr(item, "callspec", None), "params", {})
        is_dds = "dds" in fixtures and "dds" not in parameters
        transport = parameters.get("world") or parameters.get("network") or ("dds" if is_dds else "memory")
        if transport in ("dds", "zenoh"):
            item.add_marker(transport)
        is_slow = item.get_closest_marker("slow") is not None or item.get_closest_marker("needs") is not None
        if item.path.is_relative_to(CORE) and not is_slow and transport != "zenoh":
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for of_one in cases.values():
        for item in of_one[:: _step(len(of_one))]:
            item.add_marker(pytest.mark.core)


def _step(cases: int) -> int:
    return max(1, cases // max(MANY_CASES, cases // 10))


@pytest.fixture(autouse=True)
def no_processes_in_core_tests(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fail core tests that start a process."""
    if request.node.get_closest_marker("core") is not None:

        def refuse(self: object, *arguments: object, **options: object) -> None:
            raise AssertionError(f"{request.node.nodeid} starts a process: mark it slow ({arguments})")

        monkeypatch.setattr(subprocess.Popen, "__init__", refuse)
    yield
