"""Whole packages against the real rosidl tool chain: bundled and random interfaces, and damaged files."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.bundled_interfaces import INTERFACES
from support.definition_strategies import World, worlds
from support.example_counts import examples
from support.folders import TESTS
from support.rosidl_deviations import compare_or_explain
from support.rosidl_oracle import Definition, Rosidl, compare_world, ours

from rosidl_py_gen.base.resources import DataFolders

GOLDEN = TESTS / "golden" / "interfaces"


def _files(*folders: Path) -> list[Definition]:
    paths = [path for folder in folders for path in sorted(folder.glob("*/*/*"))]
    return [
        (f"{path.parts[-3]}/{path.parts[-2]}/{path.stem}", path.read_text(encoding="utf-8"), path.suffix[1:])
        for path in paths
        if path.suffix in (".msg", ".srv", ".action", ".idl")
    ]


def test_rosidl_agrees_about_every_interface_of_the_checkout(rosidl: Rosidl) -> None:
    definitions = _files(DataFolders.interfaces(), INTERFACES)
    assert len(definitions) > 230
    assert "types" in compare_world(rosidl, definitions)


def test_rosidl_agrees_about_the_golden_interfaces(rosidl: Rosidl) -> None:
    """A constant as a size and backslashes in comments are deviations, so both are replaced."""
    files = [
        (name, _no_backslash(text).replace("FromIdl_Constants::LIMIT", "4"), kind)
        for name, text, kind in _files(GOLDEN)
    ]
    assert "types" in compare_world(rosidl, files)


def _no_backslash(text: str) -> str:
    """Replace backslashes in comments, which are a deviation."""
    lines = (line.partition("#") for line in text.splitlines())
    return "\n".join(code + sign + comment.replace("\\", "/") for code, sign, comment in lines)


NAMES = [
    *(
        "a_msgs/msg/A",
        "a_msgs/msg/A9",
        "a_msgs/msg/AB",
        "a_msgs/msg/a",
        "a_msgs/msg/A_B",
        "a_msgs/msg/A_",
        "a_msgs/msg/9A",
    ),
    *("a_msgs/msg/A_Request", "a_msgs/msg/A_Event", "a_msgs/msg/A_Feedback", "a_msgs/msg/A_Request_Response"),
    *("a_msgs/msg/A_Response_Request", "a_msgs/msg/Sample_A", "a_msgs/msg/Sample_Sample_A", "a_msgs/msg/Sample_"),
    *("A_msgs/msg/A", "a__msgs/msg/A", "a_msgs_/msg/A", "_a/msg/A", "9a/msg/A", "a/msg/A", "a-b/msg/A", "ä/msg/A"),
    *(f"a_msgs/srv/A{end}" for end in ("", "_Request", "_Response", "_Goal", "_Result", "_Feedback", "_Event", "_B")),
    *(f"a_msgs/action/A{end}" for end in ("", "_Request", "_Response", "_Goal", "_Result", "_Feedback", "_SendGoal")),
    *("a_msgs/srv/Sample_A", "a_msgs/action/Sample_A", "a_msgs/srv/a", "a_msgs/action/a"),
]


@pytest.mark.parametrize("name", NAMES)
def test_rosidl_agrees_about_legal_interface_names(rosidl: Rosidl, name: str) -> None:
    kind = name.split("/")[1]
    compare_world(rosidl, [(name, {"msg": "", "srv": "---", "action": "---\n---"}[kind], kind)])


@pytest.mark.parametrize(
    "texts",
    [
        {"a_msgs/msg/A": "A x"},
        {"a_msgs/msg/A": "A[] x"},
        {"a_msgs/msg/A": "B x", "a_msgs/msg/B": "A[<=2] y"},
        {"a_msgs/msg/A": "B x", "a_msgs/msg/B": "C y", "a_msgs/msg/C": "uint8 z"},
        {"a_msgs/msg/A": "B x\nb_msgs/B y", "a_msgs/msg/B": "bool x", "b_msgs/msg/B": "a_msgs/B[2] x"},
        {"a_msgs/msg/A": "Nothing x"},
        {"a_msgs/msg/A": "c_msgs/A x"},
        {"a_msgs/msg/A": "uint8 x", "a_msgs/srv/A": "A x\n---\nA y", "a_msgs/action/A": "A x\n---\nA y\n---\nA z"},
        {"a_msgs/srv/A": "uint8 x\n---\nA_Request y"},
        {"a_msgs/srv/A": "unique_identifier_msgs/UUID x\n---\nbuiltin_interfaces/Time[] y"},
        {f"a_msgs/msg/M{n}": f"M{n - 1} x" if n else "uint8 x" for n in range(100)},
    ],
    ids=range(11),
)
def test_rosidl_agrees_about_types_that_refer_to_each_other(rosidl: Rosidl, texts: dict[str, str]) -> None:
    compare_world(rosidl, [(name, text, name.split("/")[1]) for name, text in texts.items()])


def test_types_nested_deeper_than_a_hundred_levels_are_refused_unlike_in_rosidl(rosidl: Rosidl) -> None:
    """rosidl has no limit; this package has one because its generated code is recursive."""
    texts = [(f"a_msgs/msg/M{n}", f"M{n - 1} x" if n else "uint8 x", "msg") for n in range(101)]
    assert "deeper than" in ours(texts)["unresolved"][0]
    assert all("refused" not in reply for reply in rosidl.compile(texts).values())


# --- at random --------------------------------------------------------------------------------------------------------


def _definitions(world: World) -> list[Definition]:
    return [(name, _no_backslash(text), "msg") for name, text in world.texts]


@settings(max_examples=examples(60))
@given(worlds())
def test_rosidl_agrees_about_random_packages_of_messages(rosidl: Rosidl, world: World) -> None:
    assert "types" in compare_world(rosidl, _definitions(world))


@st.composite
def _services(draw: st.DrawFn) -> list[Definition]:
    """Draw messages, and a service or action whose sections have the text of one of the messages."""
    world = draw(worlds())
    package = world.top.split("/")[0]
    kind, count = draw(st.sampled_from([("srv", 2), ("action", 3)]))
    mine = [text for name, text in world.texts if name.startswith(f"{package}/")]
    constants = "".join(f"uint8 SECTION_{number}={number}\n---\n" for number in range(count)).split("---\n")
    sections = [constants[number] + draw(st.sampled_from(["", *mine])) for number in range(count)]
    # "same constant in two sections" is a deviation: one keeps its constants, which stand in lines of their own.
    kept = sections[:1] + ["\n".join(line for line in text.splitlines() if "=7" not in line) for text in sections[1:]]
    text = "---\n".join(part if part.endswith("\n") or not part else part + "\n" for part in kept)
    return [*_definitions(world), (f"{package}/{kind}/Sample", _no_backslash(text), kind)]


@settings(max_examples=examples(30))
@given(_services())
def test_rosidl_agrees_about_random_services_and_actions(rosidl: Rosidl, definitions: list[Definition]) -> None:
    assert "types" in compare_world(rosidl, definitions)


_PIECES = (
    *("uint8", "string", "wstring<=2", "[]", "[<=2]", "[3]", "<=", "=", " ", "  ", "\t", "\n", "---\n", "#"),
    *("# ", "x", "X=1"),
    *("'", '"', "\\", "[", "]", ",", "é", "\x00", "\x0b", "\x1c", "\u2028", "-1", "0x1f", "1e400", "inf"),
    *("true", "Other"),
    *("b_msgs/Other", "a_msgs/msg/Other", "/", "_", "0", "9" * 25, "٣", "@{", "\r"),
)


@st.composite
def damaged(draw: st.DrawFn) -> Definition:
    """Draw a file in which up to three letters or tokens are wrong."""
    kind = draw(st.sampled_from(["msg", "msg", "msg", "srv", "action"]))
    lines = st.sampled_from(_LINES)
    parts = [draw(st.lists(lines, min_size=0, max_size=2)) for _ in range({"msg": 1, "srv": 2, "action": 3}[kind])]
    text = "\n---\n".join("\n".join(part) for part in parts)
    for _ in range(draw(st.sampled_from([1, 1, 2, 3]))):
        at = draw(st.integers(0, len(text)))
        end = at + draw(st.sampled_from([0, 0, 1, 1, 2, 5]))
        text = text[:at] + draw(st.sampled_from(["", *_PIECES])) + text[end:]
    return f"a_msgs/{kind}/Sample", text, kind


_LINES = (
    *(
        "uint8 x",
        "int32[3] y [1, -2, 3]",
        "string z 'it'",
        "bool b true",
        "wstring<=3[] w",
        "Other o",
        "b_msgs/Other[2] p",
    ),
    *("uint8 LIMIT=7", "string NAME='a b'", "float64 f -1.5e3", "string[] s ['a', \"b\"]", "char c 65", "# text"),
    *(
        "float32[<=2] g [1.0, .5]  # in [m]",
        "byte[] h",
        "   # more",
        "int64 BIG=-9223372036854775808",
        "string<=5 t abc",
    ),
)


@settings(max_examples=examples(500))
@given(damaged())
def test_rosidl_agrees_about_damaged_files(rosidl: Rosidl, definition: Definition) -> None:
    compare_or_explain(rosidl, definition)
