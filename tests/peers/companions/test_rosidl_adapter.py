"""`rosidl_adapter` returns and raises what the real package of Jazzy and Kilted does."""

# ruff: noqa: E501 - in tables one case is one line

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.environments import environment
from support.example_counts import examples
from support.interface_packages import write
from support.program_processes import run
from support.rosidl_oracle import RELEASES, requirements

from rosidl_py_gen.base.resources import DataFolders
from rosidl_py_gen.type_loading.import_hook import RCLPY_COMPAT_DIR

pytestmark = pytest.mark.real_time("programs are processes")
PROGRAM = Path(__file__).parent / "programs" / "describe_definitions.py"
CALLS = {"msg": "parse_message_string", "srv": "parse_service_string", "action": "parse_action_string"}
Question = list[Any]


class Parser:
    """A process that describes what its `rosidl_adapter` makes of definitions."""

    def __init__(self, python: str | Path, packages: str) -> None:
        inherited = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        self._process = subprocess.Popen(
            [str(python), "-s", str(PROGRAM)],
            env={**inherited, "PYTHONPATH": packages, "PYTHONIOENCODING": "utf-8"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            encoding="utf-8",
        )

    def describe(self, questions: list[Question]) -> list[Any]:
        assert self._process.stdin is not None and self._process.stdout is not None
        results = []
        for question in questions:
            self._process.stdin.write(json.dumps(question) + "\n")
            self._process.stdin.flush()
            results.append(json.loads(self._process.stdout.readline()))
        return results

    def close(self) -> None:
        self._process.communicate()


@pytest.fixture(scope="module")
def parsers() -> Iterator[list[Parser]]:
    made = [Parser(environment(f"rosidl-{name}", requirements(name)), "") for name in RELEASES]
    made.append(Parser(sys.executable, str(RCLPY_COMPAT_DIR)))
    yield made
    for parser in made:
        parser.close()


def assert_same(parsers: list[Parser], questions: list[Question]) -> None:
    *real, own = [parser.describe(questions) for parser in parsers]
    for question, found, *expected in zip(questions, own, *real, strict=True):
        assert [plain(found)] * len(expected) == [plain(one) for one in expected], question


def plain(description: Any) -> Any:
    """Return a description without the texts of errors about lists of strings and lost brackets, which are other ones.

    The real texts of lost brackets are about Python's `%`.
    """
    is_error = isinstance(description, list) and "Exception" in description
    if is_error and ("does not contain a '['" in description[-1] or "during string formatting" in description[-1]):
        return description[:-1]
    if is_error and description[0] in ("ValueError", "IndexError") and "duplicate" not in description[-1]:
        return description[:-1]
    return description


def test_constants_equal_real_rosidl_adapter(parsers: list[Parser]) -> None:
    assert_same(parsers, [["constants"]])


def test_bundled_interfaces_parse_like_real_rosidl_adapter(parsers: list[Parser]) -> None:
    files = [path for kind in CALLS for path in sorted(DataFolders.interfaces().glob(f"*/{kind}/*.{kind}"))]
    questions = [
        [CALLS[path.suffix[1:]], path.parts[-3], path.stem, path.read_text(encoding="utf-8")] for path in files
    ]
    assert len(questions) > 200
    assert_same(parsers, questions)
    assert_same(
        parsers,
        [
            [call.replace("string", "file"), one[1], str(path)]
            for one, path in zip(questions, files, strict=True)
            for call in one[:1]
        ],
    )


TYPES = (
    *("bool", "byte", "char", "int8", "uint64", "float32", "string", "wstring", "string<=5", "wstring<=x", "string<=0"),
    *("A", "a_msgs/B", "a_msgs/msg/B", "time", "duration", "int", "Header", "_A", "A_Request", "Sample_A", "a__b/A", "A_", ""),
)  # fmt: skip
SIZES = ("", "", "", "[]", "[3]", "[<=2]", "[0]", "[-1]", "[x]", "[ 3]", "[<=]", "]", "[2][3]", "[", "[+2]", "[1_0]")
NAMES = ("a", "b", "c_d", "A", "B_C", "a__b", "a_", "_a", "1a", "a-b", "é", "A__B", "A_", "AB1", "a")
VALUES = (
    *("", "0", "1", "-1", "255", "256", "0x1f", "0b1", "1_000", "٣", "true", "False", "TRUE", "yes", "1.5", "nan", "-inf", "1e400"),
    *('"a"', "'a'", "'a\"", '"a\\"b"', '"a"b"', "'", '"', "a b", " 'x' ", "[]", "[1]", "[1, 2]", "[1,2,3]", "[1,2,]", "[ ]", "[1"),
    *("['a', \"b\"]", "['a,b', c]", "['a\\'b']", "[,]", "['a' 'b']", "['a]", "[a, b, c]", "['abcdef']", '["\\"a\\"", \'b\\\'\']', "[1.5, x]"),
)  # fmt: skip
COMMENTS = (
    "",
    "#",
    "# a",
    "#  a [m/s]",
    "## [m] x [s]",
    "#[rad]",
    "# [a,b]",
    "  # in",
    "\t# tab ",
    "#   deep",
    "# ",
    "#x # y",
    " ",
)


@pytest.mark.parametrize("name", TYPES)
def test_types_and_values_parse_like_real_rosidl_adapter(parsers: list[Parser], name: str) -> None:
    questions: list[Question] = [["BaseType", name], ["BaseType", name, "c_msgs"]]
    questions += [["Type", name + size, *package] for size in SIZES for package in ([], ["c_msgs"])]
    questions += [["Constant", name, "A", value] for value in VALUES]
    questions += [["parse_value_string", name + size, value] for size in ("", "[]", "[2]", "[<=2]") for value in VALUES]
    assert_same(parsers, [question for question in questions if question[1]])


def test_names_are_validated_like_real_rosidl_adapter(parsers: list[Parser]) -> None:
    names = [*NAMES, *TYPES, "a\n", "A\n", "", 3, None]
    kinds = ("package", "field", "message", "constant")
    assert_same(parsers, [[f"is_valid_{kind}_name", name] for kind in kinds for name in names])


lines = st.one_of(
    st.builds("{}{} {}{}".format, st.sampled_from(TYPES), st.sampled_from(SIZES), st.sampled_from(NAMES), st.sampled_from(COMMENTS)),
    st.builds("{}{}  {} {} {}".format, st.sampled_from(TYPES), st.sampled_from(SIZES), st.sampled_from(NAMES), st.sampled_from(VALUES), st.sampled_from(COMMENTS)),
    st.builds("{} {} = {}{}".format, st.sampled_from(TYPES), st.sampled_from(NAMES), st.sampled_from(VALUES), st.sampled_from(COMMENTS)),
    st.builds("{} x{}{}".format, st.sampled_from(TYPES[:9]), st.integers(0, 99), st.sampled_from(COMMENTS)),
    st.builds("int32 X{}={}{}".format, st.integers(0, 99), st.integers(-9, 9), st.sampled_from(COMMENTS)),
    st.sampled_from([*COMMENTS, "---", "--- ", "", "x", "\f", "int8\ta", "int8 a\r", " int8 a", "int8 a\v# b", "@optional int8 a"]),
)  # fmt: skip
right_lines = st.one_of(
    st.builds("{} x{}{}".format, st.sampled_from(TYPES[:9]), st.integers(0, 999), st.sampled_from(COMMENTS)),
    st.builds("int32 X{}={}{}".format, st.integers(0, 999), st.integers(-9, 9), st.sampled_from(COMMENTS)),
    st.sampled_from(COMMENTS),
)
texts = st.one_of(st.lists(right_lines, max_size=9), st.lists(lines, max_size=3)).map("\n".join)
sections = {"msg": texts, "srv": st.lists(texts, min_size=1, max_size=3).map("\n---\n".join), "action": st.lists(texts, min_size=2, max_size=4).map("\n---\n".join)}  # fmt: skip
questions = st.sampled_from(sorted(CALLS)).flatmap(
    lambda kind: st.tuples(
        st.just(CALLS[kind]), st.sampled_from(["a_msgs", "A"]), st.sampled_from(["A", "a"]), sections[kind]
    )
)


@settings(max_examples=examples(400), deadline=None)
@given(question=questions)
def test_random_definitions_parse_like_real_rosidl_adapter(question: tuple[str, ...], parsers: list[Parser]) -> None:
    assert_same(parsers, [[*question]])


USED = """
import rosidl_adapter
from rosidl_adapter.parser import parse_message_file, parse_service_string
from rosidl_runtime_py import get_interface_path

spec = parse_message_file("sensor_msgs", get_interface_path("sensor_msgs/msg/Range"))
print(spec.base_type, [str(item) for item in spec.constants], spec.fields[2].annotations)
print(parse_service_string("a_msgs", "Ask", "string<=4[<=2] names ['a,b']  # [m]\\nint8 A=0x1f\\n---"))
"""


def test_program_can_parse_definitions_with_rosidl_adapter(tmp_path: Path) -> None:
    write(tmp_path, {"program.py": USED})
    done = run("program.py", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    first, *others = done.stdout.splitlines()
    assert first.startswith("sensor_msgs/Range ['uint8 ULTRASOUND=0', 'uint8 INFRARED=1'] {'comment': ['")
    assert others == [
        "# a_msgs/Ask",
        "# a_msgs/Ask_Request",
        "int8 A=31",
        "string<=4[<=2] names ['a,b']",
        "---",
        "# a_msgs/Ask_Response",
    ]


def test_rosidl_adapter_parses_very_long_names_and_lists_in_time() -> None:
    with subprocess.Popen(
        [sys.executable, str(PROGRAM)],
        env={**os.environ, "PYTHONPATH": str(RCLPY_COMPAT_DIR)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        hostile = [
            ["is_valid_constant_name", "A" * 50_000 + "_"],
            ["parse_value_string", "string[]", "[" + "'a'," * 20_000 + "]"],
        ]
        results, _ = process.communicate("".join(json.dumps(one) + "\n" for one in hostile), timeout=60)
    assert [len(json.loads(line)[1]) for line in results.splitlines()] == [5, 20_000]
