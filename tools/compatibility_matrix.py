"""The table of distributions, middlewares and features in `docs/reference/compatibility.md`, and the tests behind it.

Each filled cell names tests that ran with such a peer. ``python tools/compatibility_matrix.py`` runs all of
them, writes their outcomes into `tests/golden/compatibility_results.json`, and the table into the page; with
``--table`` it writes the table only. `docs/test_compatibility_matrix.py` compares, and checks that the tests exist and
are not skipped. No package index has rclpy of Humble, or on Cyclone DDS and Zenoh. Results with such a peer stay as
they were unless $ROSIDL_PEERS has it. An end such as ``[jazzy`` selects the tests whose parameters begin so.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "reference" / "compatibility.md"
RESULTS = ROOT / "tests" / "golden" / "compatibility_results.json"
DISTROS = ("Humble", "Jazzy", "Kilted", "Lyrical")
FEATURES = ("topics", "services", "actions", "parameters", "lifecycle", "graph", "type hash", "security", "bags")
UNTESTED = "not tested"
HEAD = f"|Feature|{'|'.join(DISTROS)}|\n|---|{'---|' * len(DISTROS)}\n"
_TABLE = re.compile(rf"(?<={re.escape(HEAD)})(?:\|.*\n)+")


class Cell(NamedTuple):
    """Kind of peer, and the tests with it.

    Attributes:
        peer: ``rclpy``: nodes of that distribution; ``program``: a program with the DDS library of that distribution,
            or one of the same protocol; ``bytes``: peers that the tests make of bytes in the format of rmw, or with
            the definitions and announcements of that distribution.
    """

    peer: str
    tests: tuple[str, ...]


def rclpy(distro: str, *tests: str) -> Cell:
    return Cell("rclpy", tuple(f"tests/peers/interop_rclpy/{test}[{distro}" for test in tests))


NOT_SUPPORTED = Cell("no", ())


def of_rclpy(distro: str) -> dict[str, Cell]:
    return {
        "topics": rclpy(
            distro,
            "test_topics.py::test_random_messages_arrive_as_sent",
            "test_topics.py::test_messages_of_one_megabyte_arrive_complete",
            "test_topics.py::test_late_joiners_receive_latched_messages_up_to_history_depth",
        ),
        "services": rclpy(
            distro,
            "test_services.py::test_rclpy_server_receives_and_sends_random_values",
            "test_services.py::test_rclpy_client_sends_and_receives_random_values",
        ),
        "actions": rclpy(
            distro,
            "test_actions.py::test_feedback_and_result_of_rclpy_action_server_are_received",
            "test_actions.py::test_rclpy_action_client_receives_feedback_and_result",
        ),
        "parameters": rclpy(
            distro,
            "test_parameters.py::test_parameter_client_sets_parameters_of_rclpy_node",
            "test_parameters.py::test_rclpy_client_sets_parameters",
        ),
        "lifecycle": rclpy(
            distro,
            "test_lifecycle.py::test_lifecycle_services_change_states_of_rclpy_node",
            "test_lifecycle.py::test_rclpy_client_changes_states_of_lifecycle_node",
        ),
        "graph": rclpy(
            distro,
            "test_graph.py::test_nodes_and_rclpy_nodes_discover_and_lose_each_other",
            "test_graph.py::test_rclpy_graph_follows_creation_and_closing_of_endpoints",
            "test_graph.py::test_graph_follows_creation_and_destruction_of_rclpy_endpoints",
        ),
        "type hash": rclpy(
            distro,
            "test_graph.py::test_rclpy_reports_type_hash_gid_and_qos_of_endpoints",
            "test_graph.py::test_type_hash_and_qos_of_rclpy_endpoints_are_reported",
        ),
        "bags": rclpy(distro, "test_command_line.py::test_topic_of_unknown_type_is_recorded_from_and_played_to_rclpy"),
    }


_SECURITY = "tests/peers/interop/test_security.py::"
_ZENOH = "tests/slow/runtime/transport/zenoh/"
_DEFINITIONS = "tests/core/runtime/entities/test_peer_definitions.py::"
_HUMBLE_ZENOH = f"{_ZENOH}test_humble.py::"
_LYRICAL_ZENOH = f"{_ZENOH}test_lyrical.py::"
_SECURED_CYCLONE = {
    "security": Cell("program", (f"{_SECURITY}test_secured_topics_and_services_work_with_cyclone_dds_peer",))
}
"""Cyclone DDS 0.10, which rmw_cyclonedds of Humble, Jazzy and Kilted uses."""
_SECURED_FAST_DDS = {
    "security": Cell(
        "program",
        (
            f"{_SECURITY}test_secured_services_work_with_fast_dds_peer",
            f"{_SECURITY}test_secured_topics_work_with_fast_dds_peer",
        ),
    )
}
CELLS: Mapping[str, Mapping[str, Mapping[str, Cell]]] = {
    "Fast DDS": {
        "Humble": {**of_rclpy("humble"), "type hash": NOT_SUPPORTED, **_SECURED_FAST_DDS},
        "Jazzy": {**of_rclpy("jazzy"), **_SECURED_FAST_DDS},
        "Kilted": of_rclpy("kilted"),
        "Lyrical": of_rclpy("lyrical"),
    },
    "Cyclone DDS": {
        "Humble": {**_SECURED_CYCLONE, **of_rclpy("cyclone_humble"), "type hash": NOT_SUPPORTED},
        "Jazzy": {**_SECURED_CYCLONE, **of_rclpy("cyclone_jazzy")},
        "Kilted": {**_SECURED_CYCLONE, **of_rclpy("cyclone_kilted")},
        "Lyrical": of_rclpy("cyclone_lyrical"),
    },
    "Zenoh": {
        "Humble": {
            "topics": Cell(
                "bytes", (f"{_HUMBLE_ZENOH}test_humble_format_exchanges_topics_and_services_in_both_directions",)
            ),
            "services": Cell(
                "bytes", (f"{_HUMBLE_ZENOH}test_humble_format_exchanges_topics_and_services_in_both_directions",)
            ),
            "actions": Cell(
                "bytes",
                (
                    f"{_HUMBLE_ZENOH}test_action_client_works_with_humble_server",
                    f"{_HUMBLE_ZENOH}test_action_server_works_with_humble_client",
                ),
            ),
            "graph": Cell("bytes", (f"{_HUMBLE_ZENOH}test_all_tokens_of_humble_format_are_readable_by_humble",)),
            "type hash": NOT_SUPPORTED,
            "security": NOT_SUPPORTED,
        },
        "Jazzy": {**of_rclpy("zenoh_jazzy"), "security": NOT_SUPPORTED},
        "Kilted": {**of_rclpy("zenoh_kilted"), "security": NOT_SUPPORTED},
        "Lyrical": {
            "topics": Cell(
                "bytes",
                (
                    f"{_LYRICAL_ZENOH}test_subscription_receives_samples_of_lyrical_publisher",
                    f"{_LYRICAL_ZENOH}test_own_publisher_reaches_lyrical_subscription",
                ),
            ),
            "graph": Cell(
                "bytes", (f"{_LYRICAL_ZENOH}test_only_volatile_byte_subscriptions_announce_the_cpu_backend",)
            ),
            "type hash": Cell(
                "bytes", (f"{_DEFINITIONS}test_message_of_lyrical_definition_is_dropped_and_logged[zenoh",)
            ),
            "security": NOT_SUPPORTED,
            "lifecycle": Cell(
                "bytes",
                (
                    "tests/core/runtime/lifecycle/test_lifecycle.py::"
                    "test_transition_events_of_lyrical_contain_stamp_and_transition[zenoh",
                ),
            ),
        },
    },
}
"""Cells by middleware, distribution and feature; what is not here is not tested."""


LIMITS = {"tests/peers/interop_rclpy/test_topics.py::test_random_messages_arrive_as_sent[cyclone_lyrical": 1}
"""Number of tests of a name that are expected to fail: wstring with rmw_cyclonedds of Lyrical, which the page tells."""


def named_tests() -> list[str]:
    """All tests that cells name."""
    cells = (cell for of in CELLS.values() for features in of.values() for cell in features.values())
    return sorted({test for cell in cells for test in cell.tests})


def with_built_peers() -> list[str]:
    """Return the tests with rclpy peers that no package index has."""
    tests = [test for test in named_tests() if test.startswith("tests/peers/interop_rclpy/")]
    return [test for test in tests if not test.endswith(("[jazzy", "[kilted"))]


def rows() -> Iterator[str]:
    """The rows of the table."""
    for middleware, distros in CELLS.items():
        yield f"|**{middleware}**|{'|' * len(DISTROS)}\n"
        for feature in FEATURES:
            cells = (distros[distro].get(feature) for distro in DISTROS)
            yield f"|{feature}|{'|'.join(cell.peer if cell else UNTESTED for cell in cells)}|\n"


def page(text: str) -> str:
    """The text of the page with the present table."""
    assert _TABLE.search(text), f"{PAGE} has no table with the header {HEAD}"
    return _TABLE.sub(lambda _: "".join(rows()), text)


# --- recording --------------------------------------------------------------------------------------------------------


class Recorder:
    """Plugin of pytest that runs the named tests only, and counts their outcomes."""

    def __init__(self) -> None:
        self.outcomes: defaultdict[str, Counter[str]] = defaultdict(Counter)
        self._names: dict[str, str] = {}

    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        for item in items:
            found = next((test for test in named_tests() if selects(test, item.nodeid)), None)
            if found is not None:
                self._names[item.nodeid] = found
        config.hook.pytest_deselected(items=[item for item in items if item.nodeid not in self._names])
        items[:] = [item for item in items if item.nodeid in self._names]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call" or report.outcome != "passed":
            self.outcomes[self._names[report.nodeid]][report.outcome] += 1


def selects(test: str, nodeid: str) -> bool:
    """Return True if a name in a cell means a test."""
    return nodeid == test or nodeid.startswith(test if "[" in test else f"{test}[")


def _run(folder: str, result: Path) -> None:
    """Run the tests of a folder in this process."""
    import pytest

    recorder = Recorder()
    files = sorted({test.partition("::")[0] for test in named_tests() if test.startswith(folder)})
    pytest.main(["-q", "-p", "no:cacheprovider", "--all-transports", *files], plugins=[recorder])
    result.write_text(json.dumps(recorder.outcomes), encoding="utf-8")


def record() -> None:
    """Run all named tests, each folder in a process of its own, and write their outcomes."""
    before = json.loads(RESULTS.read_text(encoding="utf-8"))
    outcomes: dict[str, dict[str, int]] = {test: before[test] for test in before if test in with_built_peers()}
    for folder in sorted({"/".join(test.split("/")[:3]) + "/" for test in named_tests()}):
        with tempfile.TemporaryDirectory() as scratch:
            result = Path(scratch, "result.json")
            subprocess.run([sys.executable, __file__, folder, result], cwd=ROOT, check=True)
            outcomes |= json.loads(result.read_text(encoding="utf-8"))
    RESULTS.write_text(json.dumps(outcomes, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) == 3:
        _run(sys.argv[1], Path(sys.argv[2]))
    else:
        if "--table" not in sys.argv:
            record()
        PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
