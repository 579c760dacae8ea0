"""Run the tests of rclpy, or of its companions, against ours, file by file.

Run it as ``python tools/run_rclpy_tests.py CHECKOUT [FILE ...]``.

CHECKOUT is one of github.com/ros2/rclpy, branch jazzy, which is only read: its `rclpy/test` is copied into a temporary
folder, with an empty `__init__.py` (theirs asks for a build). Messages are those of test_msgs, and its module
`message_fixtures`: of the environment with a real rclpy that other tests made, or of the sources that `--test-msgs`
names (github.com/ros2/rcl_interfaces, folder test_msgs). Each file has a process of its own, on this machine only.
Printed are passed of all for each file, and why a test is not; `--failed` also prints what such tests say, `--table`
the table of docs/internals/parity.md. Ends with 1 when a test fails without an explanation. Nothing is fetched,
nothing of theirs is kept.

With `--companions` CHECKOUT is a folder of those of github.com/ros2/common_interfaces, ros2/geometry2 and
ros2/message_filters (branch jazzy), ros-perception/vision_opencv and DLu/tf_transformations, by these names; missing
ones are left out. cv_bridge and image_geometry need OpenCV; `tostring` of numpy has become `tobytes` in them, and the
fields of CameraInfo are lower case, as in ROS 2. getsentry/sentry-rclpy, which replaces functions of rclpy, needs
sentry-sdk.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from support.environments import cache_folder
from support.local_network import domain_id

_CONFTEST = """
import sys

from rosidl_py_gen import install_import_hook

sys.argv[1:] = []
install_import_hook(message_api="rclpy", override_installed=True, path={paths!r})
"""
_COMPANIONS_CONFTEST = """
from contextlib import nullcontext
from types import ModuleType

import tf2_py

# Modules that load libraries on Windows, and a tf2_py that was built for its own test.
sys.modules["rpyutils"] = ModuleType("rpyutils")
sys.modules["rpyutils"].add_dll_directories_from_env = lambda name: nullcontext()
sys.modules["test_tf2_py"] = ModuleType("test_tf2_py")
sys.modules["test_tf2_py._tf2_py"] = tf2_py
"""
_COMPANIONS = (
    "common_interfaces/sensor_msgs_py/test/test_point_cloud2.py",
    "geometry2/tf2_geometry_msgs/test/test_tf2_geometry_msgs.py",
    "geometry2/tf2_py/test/test_buffer_core.py",
    "geometry2/tf2_ros_py/test/test_buffer.py",
    "geometry2/tf2_ros_py/test/test_buffer_client.py",
    "geometry2/tf2_ros_py/test/test_listener_and_broadcaster.py",
    "geometry2/tf2_sensor_msgs/test/test_tf2_sensor_msgs.py",
    "message_filters/test/directed.py",
    "message_filters/test/test_approxsync.py",
    "message_filters/test/test_message_filters_cache.py",
    "sentry-rclpy/test/test_executor.py",
    "sentry-rclpy/test/test_logging.py",
    "sentry-rclpy/test/test_pubsub.py",
    "tf_transformations/test/test_transformations.py",
    "vision_opencv/cv_bridge/test/conversions.py",
    "vision_opencv/cv_bridge/test/enumerants.py",
    "vision_opencv/cv_bridge/test/python_bindings.py",
    "vision_opencv/image_geometry/test/directed.py",
)
_PENDING = "it reads `_pending_tasks` of an executor, which rclpy of Jazzy does not have"
_COMPANION_REASONS = {
    "sentry-rclpy/test/test_executor.py": {
        "test_single_threaded_executor_depth_metrics": _PENDING,
        "test_multi_threaded_executor_depth_metrics": _PENDING,
    },
}
_C = "a class of C that ours does not have"
REASONS = {
    "test_client.py": {"test_service_timestamps": "it takes a request from the service's handle of C"},
    "test_lifecycle.py": {"test_lifecycle_node_init": "it asks the state machine of C for the services that it serves"},
    "test_node.py": {"test_take": "it takes a message from the subscription's handle of C"},
    "test_qos_event.py": {
        "test_call_publisher_rclpy_event_apis": f"it creates a `WaitSet`: {_C}",
        "test_call_publisher_rclpy_event_matched": f"it creates a `WaitSet`: {_C}",
        "test_call_subscription_rclpy_event_apis": f"it creates a `WaitSet`: {_C}",
        "test_call_subscription_rclpy_event_matched_unmatched": f"it creates a `WaitSet`: {_C}",
        "test_publisher_event_create_destroy": f"it creates an `EventHandle`: {_C}",
        "test_subscription_event_create_destroy": f"it creates an `EventHandle`: {_C}",
    },
    "test_topic_endpoint_info.py": {"test_qos_profile_only_constructor": f"it creates an `rmw_qos_profile_t`: {_C}"},
    "test_type_description_service.py": {
        "test_get_type_description": "it sends an object as a string; rclpy 7.1.5 fails it as well"
    },
    "test_waitable.py": {
        "test_waitable_with_client": f"it creates a `Client`: {_C}",
        "test_waitable_with_guard_condition": f"it creates a `GuardCondition`: {_C}",
        "test_waitable_with_server": f"it creates a `Service`: {_C}",
        "test_waitable_with_subscription": f"it creates a `Subscription`: {_C}",
        "test_waitable_with_timer": f"it creates a `Timer`: {_C}",
    },
}
"""File -> test that ours does not pass -> why."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkout", type=Path, help="of github.com/ros2/rclpy, branch jazzy")
    parser.add_argument("files", nargs="*", help="such as test_node.py; all without")
    parser.add_argument(
        "--companions", action="store_true", help="run the tests of companions; CHECKOUT has their folders"
    )
    parser.add_argument("--test-msgs", type=Path, help="sources of test_msgs")
    parser.add_argument("--failed", action="store_true", help="print the tests that did not pass, and why")
    parser.add_argument("--table", action="store_true", help="print a table in Markdown")
    parser.add_argument("--timeout", type=float, default=300, help="seconds for one file")
    given = parser.parse_args()
    all_passed = all_tests = unexplained = 0
    with tempfile.TemporaryDirectory(prefix="rclpy-tests-") as made:
        files = _companions(given.checkout, Path(made)) if given.companions else _own(parser, given, Path(made))
        form = "| `{}` | {} of {} | {} |" if given.table else "{:65} {:3} of {:3}  {}"
        for name, path in files:
            count, wrong = _run(Path(made), path, given.timeout)
            known = {**REASONS, **_COMPANION_REASONS}.get(name, {})
            reasons = _grouped({test: known.get(test, "FAILED, AND NOBODY KNOWS WHY") for test in wrong})
            print(form.format(name, count - len(wrong), count, reasons).rstrip(), flush=True)
            unexplained += len(wrong.keys() - known.keys())
            all_passed, all_tests = all_passed + count - len(wrong), all_tests + count
            if given.failed:
                print("".join(f"    {test}: {text}\n" for test, text in wrong.items()), end="", flush=True)
    print(form.format("all", all_passed, all_tests, "").rstrip())
    return int(unexplained > 0)


def _own(parser: argparse.ArgumentParser, given: argparse.Namespace, made: Path) -> Iterator[tuple[str, str]]:
    """Copy rclpy's tests; yield their names and paths."""
    source, tests = given.checkout / "rclpy" / "test", made / "test"
    if not source.is_dir():
        parser.error(f"{source} is no folder")
    shutil.copytree(source, tests)
    (tests / "__init__.py").write_text("")
    (made / "conftest.py").write_text(_CONFTEST.format(paths=_definitions(given.test_msgs, made)))
    for name in given.files or sorted(path.name for path in tests.glob("test_*.py")):
        yield name, f"test/{name}"


def _companions(checkouts: Path, made: Path) -> Iterator[tuple[str, str]]:
    """Copy each test of the companions; yield its name and path."""
    sentry = f"sys.path.append({str((checkouts / 'sentry-rclpy').resolve())!r})\n"
    (made / "conftest.py").write_text(_CONFTEST.format(paths=[]) + _COMPANIONS_CONFTEST + sentry)
    for name in _COMPANIONS:
        source = checkouts / name
        if source.is_file():
            text = source.read_text(encoding="utf-8").replace("tostring()", "tobytes()")
            text = re.sub(r"(?<=[lr]msg\.)[DKPR](?= = )", lambda found: found[0].lower(), text)
            folder = made / name.split("/")[0]
            folder.mkdir(exist_ok=True)
            (folder / source.name).write_text(text, encoding="utf-8")
            if (own := source.parent / "conftest.py").is_file():
                shutil.copy(own, folder)
            yield name, f"{folder.name}/{source.name}"
        else:
            print(f"{name:65} not there")


def _grouped(reasons: dict[str, str]) -> str:
    """``a, b: why; c: why``."""
    whys = dict.fromkeys(reasons.values())
    return "; ".join(f"{', '.join(f'`{test}`' for test in reasons if reasons[test] == why)}: {why}" for why in whys)


def _definitions(sources: Path | None, made: Path) -> list[str]:
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


def _run(folder: Path, name: str, timeout_s: float) -> tuple[int, dict[str, str]]:
    report = folder / "report.xml"
    report.unlink(missing_ok=True)
    settings = {
        **{key: value for key, value in os.environ.items() if not key.startswith(("ROS_", "RMW_", "AMENT_"))},
        "ROS_DOMAIN_ID": str(domain_id()),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "SENTRY_RELEASE": "1",  # Sentry would ask git in the folder of the tests
    }
    options = ["-q", "-p", "no:cacheprovider", "-o", "junit_family=xunit1", f"--junitxml={report}", "--rootdir=."]
    command = [sys.executable, "-m", "pytest", *options, "-p", "no:rosidl_py_gen", name]
    try:
        done = subprocess.run(
            command, cwd=folder, env=settings, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=timeout_s
        )
        last = done.stdout.decode(errors="replace").strip().splitlines()[-1:]
    except subprocess.TimeoutExpired as late:
        return 1, {"all": f"no end within {timeout_s:g} s: {(late.stdout or b'').decode(errors='replace')[-300:]}"}
    if not report.exists():
        return 1, {"all": f"ended with {done.returncode}: {' '.join(last)}"}
    cases = [*ElementTree.parse(report).getroot().iter("testcase")]
    wrong: dict[str, str] = {}
    for case in cases:
        found = next((one for kind in ("failure", "error", "skipped") if (one := case.find(kind)) is not None), None)
        if found is not None:
            text = " ".join((found.get("message") or found.text or "").split())
            wrong.setdefault(str(case.get("name")), f"{found.tag}: {text[:200]}")
    return max(len({(case.get("classname"), case.get("name")) for case in cases}), 1), wrong


if __name__ == "__main__":
    sys.exit(main())
