"""Interface files are untrusted: their text becomes inert, well-formed code, or an error.

Every case is generated, formatted, linted, imported and used; a payload that ran would leave a mark in the environment.
"""

# ruff: noqa: E501 - in tables one case is one line
from __future__ import annotations

import ast
import builtins
import dataclasses
import importlib
import os
import resource
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from each_case import each_case
from support.interface_packages import assert_clean, importable, message, run, source_of, write
from support.rclpy_messages import hooked, rclpy_class

from rosidl_py_gen import decode, encode, from_dict, to_dict, type_name
from rosidl_py_gen.base.names import py_name
from rosidl_py_gen.errors import DefinitionError

MARK = "ROSIDL_PAYLOAD_RAN"
CALL = f"__import__('os').environ.__setitem__('{MARK}','1')"

# Hostile text for comments, units, defaults and constants.
EVIL = {
    "call": CALL,
    "triple": f'"""\n{CALL}\n"""'.replace("\n", " "),
    "triple_single": f"'''; {CALL}; '''",
    "ends_in_quote": 'say "',
    "four_quotes": '""""',
    "many_quotes": '"' * 7,
    "backslash_end": "end \\",
    "backslash_quote": '\\"""',
    "two_backslashes": '\\\\"""',
    "escapes": "\\n \\x41 \\u0041 \\N{BULLET} \\101 \\",
    "jinja": "{{ 7 * 7 }} {% for i in x %} {# no #} {%- endfor -%}",
    "jinja_payload": "{{ ''.__class__.__mro__[1].__subclasses__() }}",
    "f_string": "{" + CALL + "}",
    "percent": "%s %(x)s {0} {x!r}",
    "code": f"); {CALL} #",
    "new_line_inside": f"text\x0b{CALL}\x0c{CALL}\x1c{CALL}\x85{CALL}\u2028{CALL}",
    "null": f"a\x00{CALL}",
    "control": "\x01\x07\x08\x1b[31mred\x7f",
    "bidi": "\u202e\u2066 level \u2069 \u200b\ufeff",
    "wide": "ハ 😀 ünïcödé \U000e0041",
    "noqa": "noqa: E501  type: ignore  fmt: off  isort: skip_file",
    "coding": "-*- coding: utf-7 -*-",
    "long": "word " * 400,
    "unbroken": "x" * 3000,
    "percent_unit": "[%]",
}

# --- text in every place ----------------------------------------------------------------------------------------------


def in_comments(text: str) -> str:
    """Return a definition with a text as comment of the file, of elements and of a constant, and as unit."""
    cut = text.replace("#", "").splitlines()[0] if text.splitlines() else ""
    unit = cut.replace("[", "").replace("]", "").replace(",", "")
    return (
        f"# {cut}\n# {cut}\n\n# {cut}\nuint8 a 1 # {cut}\n   # {cut}\nuint8 b # [{unit}]\n"
        f"# {cut}\nuint8 C=3 # {cut}\nstring D=x # [{unit}]"
    )


def in_values(text: str) -> str:
    """Return a definition with a text as default and constant."""
    safe = text.replace("#", "").replace("=", "").splitlines()[0].replace("\\", "/").replace("\t", " ").strip()
    single = safe.replace("'", "")
    return f"string a x{safe}\nstring b '{single}'\nstring C=x{safe}\nstring[] d ['x{single}']\nstring E='{single}'"


CASES: dict[str, str] = {
    **{f"comment_{name}": in_comments(text) for name, text in EVIL.items()},
    **{f"value_{name}": in_values(text) for name, text in EVIL.items() if name not in ("null", "new_line_inside", "wide", "bidi")},
    "comment_invisible": in_comments("\x01 \u202e"),
    "comment_service": "# \x07\n\n#\x07\nuint8 a",
    "value_escapes": 'string a "\\t\\"\\\\x41 {{ x }}"\nstring B=\'"""\'\nstring d \'\\\'\\\'\\\'\'',
    "value_null": 'string a "a\\0b"\nstring B=\\x00',
    "value_wide": "string a ハ😀\nwstring B=\"ü\"",
}  # fmt: skip

WORDS = [
    *("np", "int", "field", "self", "cls", "classmethod", "dataclass", "message", "struct", "data", "copy", "raw", "view"),
    *("encode", "decode", "fields", "list", "bytes", "str", "bool", "float", "type", "id", "object", "super", "range", "len"),
    *("pos", "end", "parts", "append", "error", "new", "readable", "typing", "annotations", "property", "staticmethod"),
    *("print", "exec", "eval", "open", "tuple", "dict", "set", "memoryview", "bytearray", "slots", "builtins", "numpy"),
    *("from", "in", "is", "class", "def", "lambda", "yield", "async", "await", "match", "case", "none", "true", "import"),
    *("encode_slow", "decode_slow", "packers", "limit", "exactly", "within", "expect", "check_max_lengths", "fault", "getattr"),
]  # fmt: skip

CASES |= {
    "names_of_fields": "\n".join(f"uint8 {word}" for word in WORDS),
    "names_of_arrays": "\n".join(f"float64[] {word}" for word in WORDS),
    "names_of_strings": "\n".join(f"string[<=3] {word}" for word in WORDS),
    "names_of_defaults": "\n".join(f"int16[2] {word} [1,2]" for word in WORDS),
    "names_of_messages": "\n".join(f"Other[] {word}" for word in WORDS),
    "names_of_constants": "uint8 NP=1\nuint8 ANY=1\nstring T=x\nfloat32 NDARRAY=1\nuint8 S=1\nuint8 TYPE=1\nuint8 TYPE_CHECKING=1\nuint8[] x",
    "one_letter": "\n".join(f"uint8[] {letter}" for letter in "abcdefghijklmnopqrstuvwxyz"),
    "long_names": "\n".join(f"{kind} {'very_long_name_' * 20}{i}" for i, kind in enumerate(("uint8", "string", "float64[]", "Other"))),
    "empty": "",
    "only_constants": "uint8 A=1",
    "huge_array": "uint8[200000000] x",
    "huge_bound": "uint8[<=4294967295] x\nstring<=4294967295 s\nfloat64[<=18446744073709551615] z",
}  # fmt: skip
# Message names that Python, typing or our own support code know by the same name.
NAMES = [
    *("Message", "Struct", "ClassVar", "TypeInfo", "None", "True", "False", "NotImplemented", "Any", "Self"),
    *("Readable", "Fault", "Append", "NDArray", "List", "Exception", "Type", "ValueError", "Field", "Dataclass"),
    *("Np", "N", "Request", "Response", "Event", "Goal", "Result", "Feedback", "Sample", "Float64s", "Uint8s"),
]


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Generate a package for every case, and make the packages importable."""
    base = tmp_path_factory.mktemp("hostile")
    files = {}
    for name, text in CASES.items():
        files[f"{name}/msg/Sample.msg"] = text
        files[f"{name}/msg/Other.msg"] = "uint8 x"
    fields = "\n".join(f"{name} f{i}\n{name}[] s{i}" for i, name in enumerate(NAMES))
    for name in NAMES:
        files[f"named_msgs/msg/{name}.msg"] = "float64 x\nstring[] text\nuint8[4] raw"
        files[f"other_msgs/msg/{name}.msg"] = "float64 x\nstring[] text\nuint8[4] raw"
    files["user_msgs/msg/All.msg"] = "\n".join(
        f"named_msgs/{name} a{i}\nother_msgs/{name} b{i}\nother_msgs/{name}[] c{i}" for i, name in enumerate(NAMES)
    )
    files["named_msgs/msg/Uses.msg"] = fields
    files["named_msgs/srv/Service.srv"] = "Message m\n---\nStruct s\nNone n"
    files["named_msgs/action/Action.action"] = "Message m\n---\nTrue t\n---\nAny a"
    out = base / "out"
    run(write(base / "in", files), out)
    os.environ.pop(MARK, None)
    with importable(out):
        yield out


def check_inert() -> None:
    assert MARK not in os.environ, "text of a definition ran as code"


@each_case("name", CASES)
def test_hostile_text_becomes_inert_code(generated: Path, name: str) -> None:
    source = (generated / name / "msg" / "_sample.py").read_text(encoding="utf-8")
    tree = ast.parse(source)
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id == "__import__"]
    cls = importlib.import_module(f"{name}.msg").Sample
    value = cls()
    check_inert()
    interface = message(CASES[name], f"{name}/msg/Sample")
    for item in interface.fields:
        if isinstance(item.default, (str, int, float)):
            assert getattr(value, py_name(item.name)) == item.default
    for constant in interface.constants:
        assert getattr(cls, py_name(constant.name)) == constant.value
    if name != "huge_array":
        assert decode(cls, encode(value)) == value
        assert from_dict(cls, to_dict(value)) == value
    check_inert()


@pytest.mark.slow
def test_generated_code_is_formatted_and_clean(generated: Path) -> None:
    assert_clean(generated)


@each_case("package", ["named_msgs", "other_msgs"])
@each_case("name", NAMES)
def test_message_named_like_python_or_support_code_round_trips(generated: Path, package: str, name: str) -> None:
    cls = getattr(importlib.import_module(f"{package}.msg"), py_name(name))
    value = cls(x=1.5, text=["a"], raw=[1, 2, 3, 4])
    assert type_name(cls) == f"{package}/msg/{name}"
    assert decode(cls, encode(value)) == value


@pytest.mark.parametrize("name", ["named_msgs.msg.Uses", "user_msgs.msg.All"])
def test_messages_of_any_name_can_be_types_of_fields(generated: Path, name: str) -> None:
    module, _, stem = name.rpartition(".")
    cls = getattr(importlib.import_module(module), stem)
    value = cls()
    for item in dataclasses.fields(value):
        part = getattr(value, item.name)
        if item.name == "a0":
            assert type(part).__module__ == "named_msgs.msg._message"
        if not isinstance(part, list):
            part.x = 2.5
            part.text = ["t"]
    assert decode(cls, encode(value)) == value
    assert from_dict(cls, to_dict(value)) == value


def test_rclpy_style_messages_with_fields_named_like_functions_round_trip(tmp_path: Path) -> None:
    # With an underscore, these are names of functions of generated classes.
    words = ("encode", "decode", "write", "read", "native", "assign", "check_fields")
    text = "\n".join(f"int32 {name}" for name in words)
    heavy = "\n".join(f"int32 field_{number}" for number in range(60))
    write(tmp_path, {"odd_msgs/msg/Words.msg": text, "odd_msgs/msg/Heavy.msg": f"{heavy}\n{text}\nWords words"})
    with hooked(message_api="rclpy", path=tmp_path):
        cls = rclpy_class("odd_msgs/msg/Heavy")
        made = cls(encode=1, decode=2, write=3, read=4, native=5, assign=6)
        made.words.encode = 9
        found = decode(cls, encode(made))
        assert (found.encode, found.read, found.assign, found.words.encode) == (1, 4, 6, 9)
        assert found == made and to_dict(found)["write"] == 3


def test_services_and_actions_of_oddly_named_types_round_trip(generated: Path) -> None:
    service = importlib.import_module("named_msgs.srv").Service
    action = importlib.import_module("named_msgs.action").Action
    for cls in (service.Request, service.Response, action.Goal, action.Result, action.FeedbackMessage):
        assert decode(cls, encode(cls())) == cls()


def test_generated_modules_do_not_change_python_or_write_files(generated: Path) -> None:
    for path in generated.rglob("_*.py"):
        importlib.import_module(".".join(path.relative_to(generated).with_suffix("").parts))
    check_inert()
    assert builtins.print.__self__ is builtins  # type: ignore[attr-defined]
    assert [str(one) for one in generated.parent.iterdir() if one.name not in ("in", "out")] == []


# --- shapes -----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("length", [1_000_000])
def test_line_of_a_megabyte_is_compiled_or_refused_in_bounded_time(length: int) -> None:
    start = time.process_time()
    interface = message(f"# {'c' * length}\nstring a {'x' * length}\nstring B={'y' * length}\n")
    assert interface.constants[0].value == "y" * length
    source = source_of({"a_msgs/msg/A": f"# {'c' * length}\nstring a {'x' * length}\n"})
    compile(source, "A", "exec")
    with pytest.raises(DefinitionError):
        source_of({"a_msgs/msg/A": f"uint8 {'x' * length}!"})
    with pytest.raises(DefinitionError):
        source_of({"a_msgs/msg/A": f"{'X' * length} x"})
    with pytest.raises(DefinitionError) as caught:
        source_of({"a_msgs/msg/A": f"uint8 x {'1' * length}"})
    assert len(str(caught.value)) < 1000
    assert time.process_time() - start < 20


@pytest.mark.slow
def test_two_thousand_fields_are_generated_and_imported(tmp_path: Path) -> None:
    kinds = ("uint8", "float64", "string", "uint16[]", "int32[3]", "bool")
    text = "\n".join(f"{kinds[i % len(kinds)]} f{i}" for i in range(2000))
    out = tmp_path / "out"
    start = time.process_time()
    run(write(tmp_path / "in", {"big_msgs/msg/Big.msg": text}), out)
    assert time.process_time() - start < 30
    with importable(out):
        cls = importlib.import_module("big_msgs.msg").Big
        value = cls(f0=7)
        assert decode(cls, encode(value)).f0 == 7


def test_compiling_a_huge_array_allocates_little() -> None:
    """Reading, planning and emitting a huge array, and refusing one, all need little memory."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    source = source_of({"a_msgs/msg/A": "uint8[250000000] x\nfloat64[<=18446744073709551615] y\nuint8 z"})
    compile(source, "A", "exec")
    with pytest.raises(DefinitionError, match=r":1:19: .* has 4294967295 bytes in fixed arrays up to here, at most"):
        source_of({"a_msgs/msg/A": "uint8[4294967295] x\nfloat64[18446744073709551615] y\nuint8 z"})
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # KiB


def test_line_endings_do_not_change_the_generated_code(tmp_path: Path) -> None:
    text = "# head\n\nuint8 a # first\n   # more\nuint8 B=1\n"
    for number, end in enumerate(("\r\n", "\r")):
        run(write(tmp_path / f"in{number}", {"a_msgs/msg/A.msg": text.replace("\n", end)}), tmp_path / f"out{number}")
        assert (tmp_path / f"out{number}/a_msgs/msg/_a.py").read_text() == source_of({"a_msgs/msg/A": text})
