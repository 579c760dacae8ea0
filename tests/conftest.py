"""Settings all tests share: hypothesis without deadlines, how long the fuzzers run, Ctrl-C as in a terminal, and which
tests are quick: without processes, DDS, Zenoh and oracles, with a tenth of the examples and of a test's many cases.
Core tests are the quick ones and those of nodes on DDS in one process.
"""

from __future__ import annotations

import compileall
import gc
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
from support.without_message_packages import restart_without_message_packages

from rosidl_py_gen.base.resources import WITHOUT_WHEELS, missing_extra_message
from rosidl_py_gen.runtime.transport.cyclone import library

NOT_QUICK = re.compile(
    r"interop|oracle|test_code_blocks|test_site|test_stress|test_wheel|test_two_processes|test_examples"
    r"|test_notebooks|test_scale|test_packages|_typing|test_pytest_plugin|process|test_runner|transport/|test_foxglove"
    r"|tests/ros_compat/|test_zenoh|a_thread_that_reads_on|test_command_line|test_install_hints|test_libddsc|test_setup_py|test_setup_idioms|test_package_bounds|test_completion|tests/generator_cli/|cmake_agrees|type_checkers|importing"
    r"|forked_child|broken_cyclonedds_uri|cyclonedds_itself|ctrl_c|prototypes_survive|comes_from_standard_input"
    r"|needs_neither_lark|foreign_package_of_the_same_name|clean_code|formatted_and_clean|left_alone_by_the_formatter"
    r"|every_byte|need_little_memory|two_thousand_fields|maximum_of_fields|every_error_class|bytes_of_a_database_may_be_wrong"
    r"|without_the_extra|without_network_or_proc|forgotten_node_lives|starts_without_what|killed_server|during_a_flood|pages_hide_nothing"
    r"|against_rclpy|rclpy_messages/test_codec|second_start_needs|classes_are_those_of_everybody|without_it_nothing_changes"
    r"|test_bag_record|no_more_memory_than|far_deeper|deeper than|test_random_tables"
    r"|companions/|ros_cli/test_run|files_end_soon|line_of_a_megabyte|every_count_is_as_large|what_breaks_off_says|time_limits_end_at_their_time"
    r"|fuzz/|_random|against_|cdr/test_peers|tables/test_(dataset|blocks|writing|many)|bags/test_edges|test_threads_and_loops|compatibility/test_old_data"
    r"|test_docstrings|test_public_face|very_deep_and_very_wide|works_on_zenoh_is|none_of_many_calls"
    r"|killed_recorder|interrupts_no_wait|hundred_goals|thousand_goals|every_message_of_the_checkout|for_the_same_reason"
    r"|whole_bags_show_progress|pipes_get_results_only|listed_at_80_columns|the_environment_selects|no_compiler_for_the_selection"
    r"|hook_uses_a_distribution|test_prefix|test_launch|test_package_tests"
)
"""Tests and files of tests that start processes, or take long by themselves."""
MANY_CASES = 400
"""A quick run has the same part of so many cases of a test as of random examples, at least; they are evenly spread."""
OF_PROCESSES = {
    "browser",
    "dds",
    "network",
    "rosidl",
    "start_peer",
    "topic_peer",
    "run_page",
    "clean",
    "tool",
    "run_here",
    "pytester",
}
"""Fixtures that start processes."""
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
PASSED_FILE = os.environ.get("ROSIDL_TEST_PASSED", "")
"""A file to which quick runs add the tests that pass; other runs leave those out that would do the same again."""

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
    if _is_quick(config):
        os.environ.setdefault("ROSIDL_TEST_EXAMPLES", "0.1")
        # Workers return freed memory to the system; else each would keep 80 MB of it.
        for name, value in {"ARENA_MAX": 2, "TRIM_THRESHOLD_": 1 << 17, "MMAP_THRESHOLD_": 1 << 17}.items():
            os.environ.setdefault(f"MALLOC_{name}", str(value))
        config.pluginmanager.register(WithoutSlowFiles())
        if PASSED_FILE and "PYTEST_XDIST_WORKER" not in os.environ:
            config.pluginmanager.register(_PassedTests())
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


class _PassedTests:
    """Records the tests that pass."""

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call" and report.passed:
            with open(PASSED_FILE, "a", encoding="utf-8") as file:
                print(report.nodeid, file=file)


class _WithoutAssertions:
    """Loads the package as Python does: pytest would rewrite the assertions of its hundreds of modules in every run."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        return PathFinder.find_spec(name, path, target) if name.startswith("rosidl_py_gen.") else None


def pytest_collection_finish() -> None:
    gc.collect()
    gc.freeze()


class WithoutSlowFiles:
    """Skip collecting files without quick tests, to save import time."""

    def pytest_ignore_collect(self, collection_path: Path, config: pytest.Config) -> bool | None:
        inside = collection_path.is_relative_to(config.rootpath)
        return True if inside and NOT_QUICK.search(collection_path.relative_to(config.rootpath).as_posix()) else None


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
                if sys.version_info[:2] >= WITHOUT_WHEELS.get(name, (4, 0)):
                    pytest.skip(str(missing_extra_message(cause)), allow_module_level=True)
                if name in ONLY_IN_TEST_ALL and "ROSIDL_TEST_REQUIRE_PEERS" not in os.environ:
                    pytest.skip(_needs(name), allow_module_level=True)
            raise


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module:
    return _ModuleOfTests.from_parent(parent, path=module_path)  # type: ignore[no-any-return]


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip tests marked `needs` for a module that is not installed."""
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


def _is_quick(config: pytest.Config) -> bool:
    return str(config.getoption("-m")) in {"quick", "core"}


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        if is_hypothesis_test(getattr(item, "obj", None)):
            item.add_marker(pytest.mark.timeout(_SHRINKING_S))
        fixtures = set(getattr(item, "fixturenames", ()))
        if "memory" in fixtures:
            fixtures.discard("tool")
        transport = getattr(getattr(item, "callspec", None), "params", {}).get("world", "memory")
        if fixtures & OF_PROCESSES or NOT_QUICK.search(item.nodeid):
            continue
        if transport in ("memory", "dds"):
            item.add_marker(pytest.mark.core)
        if transport == "memory":
            item.add_marker(pytest.mark.quick)
        if item.get_closest_marker(str(config.getoption("-m"))):
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    if _is_quick(config):
        selected = {item for of_one in cases.values() for item in of_one[:: _step(len(of_one))]}
        config.hook.pytest_deselected(items=[item for item in items if item not in selected])
        items[:] = [item for item in items if item in selected]
    elif PASSED_FILE and os.path.exists(PASSED_FILE):
        passed = set(Path(PASSED_FILE).read_text(encoding="utf-8").splitlines())
        items[:] = [item for item in items if item.nodeid not in passed]


def _step(cases: int) -> int:
    return max(1, cases // max(examples(MANY_CASES), examples(cases)))


@pytest.fixture(autouse=True)
def no_processes_in_quick_runs(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fail quick tests that start a process."""
    if _is_quick(request.config):

        def refuse(self: object, *arguments: object, **options: object) -> None:
            raise AssertionError(f"{request.node.nodeid} starts a process and is marked as quick: {arguments}")

        monkeypatch.setattr(subprocess.Popen, "__init__", refuse)
    yield
