"""The public face is the recorded one: what `docs/reference/versions.md` promises does not change by accident."""

from __future__ import annotations

import inspect
import re
from importlib import import_module

import pytest
from record_public_api import RECORD, ROOT, all_untold, difference, face

CHANGED = """\
The public face is not the recorded one any more:

{lines}

If this was not meant: docs/reference/versions.md promises these names and signatures. Bring them back, or begin
with _ what users shall not use. If it was meant: record it with

    python tools/record_public_api.py

and commit that with the change and a line in CHANGELOG.md. From 1.0 on, what is taken away or changed has to be
deprecated first: docs/reference/versions.md says how."""


@pytest.fixture(scope="module")
def found() -> str:
    return face()


def test_public_api_equals_recorded_api(found: str) -> None:
    changes = difference(RECORD.read_text(encoding="utf-8"), found)
    assert not changes, CHANGED.format(lines="\n".join(changes))


def test_api_difference_shows_old_and_new_lines() -> None:
    before = "class Node\n    def close() -> None\n    name: str\n"
    changed = difference(before, before.replace("close()", "close(now: bool)"))
    assert changed == ["-class Node: def close() -> None", "+class Node: def close(now: bool) -> None"]
    assert difference(before, before) == []


def test_recorded_api_contains_no_private_names(found: str) -> None:
    names = [re.sub(r"^(async |def |class )*", "", line.strip()) for line in found.splitlines()]
    assert len(names) > 900
    assert [name for name in names if name.startswith("_") and not name.startswith("__init__(")] == []


@pytest.mark.parametrize(
    "lines",
    [
        "class runtime.MemoryTransport\n    __init__(clocks: ClockFunctions | None = None)\n",
        "class runtime.ClientGoal\n    accepted_stamp: Time | None\n",  # made by a client: no constructor
        "class runtime.Subscription\n    (async for)\n    def close() -> None\n",
        "    def get_parameter(name: str) -> PythonValue\n    def get_parameter(name: str, type: type[T], ",
        "    async def receive(timeout_s: float | None = None) -> T\n    receive_sync\n",  # one docstring for both
        "class bags.BagMessage(NamedTuple)\n    topic: str\n    message: Any\n",  # the order of fields counts
        "class runtime.TransitionCallbackReturn(Enum)\n    ERROR\n    FAILURE\n    SUCCESS\n",
        "class runtime.LifecycleNode(Node)\n    __init__(name: str, namespace: str = '', ",  # inherited
        "\nruntime.qos.DEFAULT = QoSProfile()\n",
        "\ndef type_hash(subject: object) -> str\n",
        "\nros_domain: MemoryTransport\n",
        "\nrosidl-py-gen\n    --version\n    --path DIR ...\n    --distro humble|jazzy|kilted|lyrical|rolling\n",
        "\nrosidl-py bag convert\n    PATH\n    OUTPUT\n    -s, --storage mcap|sqlite3\n",
    ],
)
def test_recorded_api_contains_every_kind_of_entry(found: str, lines: str) -> None:
    assert lines in found


# Public because of a class that they replace a method of, or a protocol that says what they do; users do not call them.
FOR_OTHERS = ["runtime.RosLogger.findCaller", "runtime.MemoryTransport.open"]


def test_api_pages_hide_nothing_and_document_every_public_member() -> None:
    assert [
        page.name for page in (ROOT / "docs/reference/api").glob("*.md") if "filters:" in page.read_text("utf-8")
    ] == []
    assert sorted(all_untold()) == sorted(FOR_OTHERS)


@pytest.mark.parametrize("module", ["runtime", "tf", "message_filters", "bags", "runtime.pytest_plugin"])
def test_awaitable_methods_without_blocking_form_state_the_reason(module: str) -> None:
    found = vars(import_module(f"rosidl_py_gen.{module}"))
    classes = [value for name, value in found.items() if inspect.isclass(value) and not name.startswith("_")]
    for cls in (one for one in classes if one.__module__.startswith("rosidl_py_gen.")):
        for name in (name for name in dir(cls) if not name.startswith("_")):
            method = inspect.getattr_static(cls, name)
            if inspect.iscoroutinefunction(method) or inspect.isasyncgenfunction(method):
                text = inspect.getdoc(method) or ""
                assert hasattr(cls, f"{name}_sync") or "no blocking form" in " ".join(text.split()), f"{cls}.{name}"
