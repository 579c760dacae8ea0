"""``python tests/run_rclpy_tests.py CHECKOUT [FILE ...]``: rclpy's own tests against our rclpy, file by file.

CHECKOUT is one of github.com/ros2/rclpy, branch jazzy, which is only read: its `rclpy/test` is copied into a temporary
folder, with an empty `__init__.py` (theirs asks for a build). Messages are those of test_msgs, and its module
`message_fixtures`: of the environment with a real rclpy that other tests made, or of the sources that `--test-msgs`
names (github.com/ros2/rcl_interfaces, folder test_msgs). Each file has a process of its own, on this machine only.
Printed are passed of all for each file, with `--failed` also the tests that did not pass. Nothing is fetched, nothing
of theirs is kept.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from environments import cache_folder
from worlds import domain_id

_CONFTEST = """
import sys

from rosidl_py_gen import install_import_hook

sys.argv[1:] = []
install_import_hook(flavour="rclpy", shadow=True, path={paths!r})
"""
_UNFAIR = {
    "test_waitable.py": "wait sets of C objects",
    "test_destruction_order.py": "the order in which C objects end",
    "test_qos_overriding_options.py": "helpers that are private to rclpy",
}
"""Files that look at what is not public."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkout", type=Path, help="of github.com/ros2/rclpy, branch jazzy")
    parser.add_argument("files", nargs="*", help="such as test_node.py; all without")
    parser.add_argument("--test-msgs", type=Path, help="sources of test_msgs")
    parser.add_argument("--failed", action="store_true", help="print the tests that did not pass, and why")
    parser.add_argument("--timeout", type=float, default=300, help="seconds for one file")
    given = parser.parse_args()
    source = given.checkout / "rclpy" / "test"
    if not source.is_dir():
        parser.error(f"{source} is no folder")
    all_passed = all_tests = 0
    with tempfile.TemporaryDirectory(prefix="rclpy-tests-") as made:
        tests = Path(made, "test")
        shutil.copytree(source, tests)
        (tests / "__init__.py").write_text("")
        paths = _definitions(given.test_msgs, Path(made))
        Path(made, "conftest.py").write_text(_CONFTEST.format(paths=paths))
        for name in given.files or sorted(path.name for path in tests.glob("test_*.py")):
            passed, count, lines = _run(Path(made), f"test/{name}", given.timeout)
            all_passed, all_tests = all_passed + passed, all_tests + count
            print(f"{name:45} {passed:3} of {count:3}  {_UNFAIR.get(name, '')}".rstrip(), flush=True)
            if given.failed:
                print("".join(f"    {line}\n" for line in lines), end="", flush=True)
    print(f"{'all':45} {all_passed:3} of {all_tests:3}")
    return 0


def _definitions(sources: Path | None, made: Path) -> list[str]:
    """Where test_msgs is: its definitions, and its Python module, copied beside the tests."""
    if sources is None:
        found = sorted(cache_folder().glob("rclpy-jazzy-*/share/test_msgs"))
        if not found:
            raise SystemExit("no test_msgs: name its sources with --test-msgs")
        sources = found[0]
        python = next(iter(sources.parents[1].glob("lib/python3*/site-packages/test_msgs")))
    else:
        python = sources / "src" / "test_msgs"
        python = python if python.is_dir() else sources / "test_msgs"
    place = made / "definitions" / "test_msgs"
    for kind in ("msg", "srv", "action"):
        place.joinpath(kind).mkdir(parents=True)
        for file in sources.joinpath(kind).glob(f"*.{kind}"):
            shutil.copy(file, place / kind)
    (place / "package.xml").write_text("<package><name>test_msgs</name></package>")
    (place / "test_msgs").mkdir()
    (place / "test_msgs" / "__init__.py").touch()
    shutil.copy(python / "message_fixtures.py", place / "test_msgs")
    return [str(place)]


def _run(folder: Path, name: str, timeout_s: float) -> tuple[int, int, list[str]]:
    """Passed, all, and a line for each test that did not pass."""
    report = folder / "report.xml"
    report.unlink(missing_ok=True)
    settings = {
        **{key: value for key, value in os.environ.items() if not key.startswith(("ROS_", "RMW_", "AMENT_"))},
        "ROS_DOMAIN_ID": str(domain_id()),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    options = ["-q", "-p", "no:cacheprovider", "-o", "junit_family=xunit1", f"--junitxml={report}", "--rootdir=."]
    command = [sys.executable, "-m", "pytest", *options, "-p", "no:rosidl_py_gen", name]
    try:
        done = subprocess.run(
            command, cwd=folder, env=settings, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=timeout_s
        )
        last = done.stdout.decode(errors="replace").strip().splitlines()[-1:]
    except subprocess.TimeoutExpired as late:
        return 0, 1, [f"no end within {timeout_s:g} s: {(late.stdout or b'').decode(errors='replace')[-300:]}"]
    if not report.exists():
        return 0, 1, [f"ended with {done.returncode}: {' '.join(last)}"]
    cases = [*ElementTree.parse(report).getroot().iter("testcase")]
    wrong = []
    for case in cases:
        found = next((one for kind in ("failure", "error", "skipped") if (one := case.find(kind)) is not None), None)
        if found is not None:
            text = " ".join((found.get("message") or found.text or "").split())
            wrong.append(f"{case.get('name')}: {found.tag}: {text[:200]}")
    return len(cases) - len(wrong), max(len(cases), 1), wrong


if __name__ == "__main__":
    sys.exit(main())
