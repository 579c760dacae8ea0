"""Random and damaged definitions of every origin yield a class or our error, in bounded time and memory.

A step of the state machine passes one definition to one entry point. Later steps see the state that it leaves, such as
cached classes. Hypothesis prints how to repeat a failure.
"""

from __future__ import annotations

import time
import tracemalloc
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule
from support.example_counts import examples

from rosidl_py_gen import compile_definition, decode, encode, from_dict, to_dict, type_hash, type_name
from rosidl_py_gen.bags import DecoderFactory
from rosidl_py_gen.base.descriptions import TypeDescriptions
from rosidl_py_gen.cdr.type_queries import type_description
from rosidl_py_gen.errors import DefinitionError, RosidlError
from rosidl_py_gen.type_loading.from_description import DescribedType, definition_text

LINE = "=" * 80
MAX_S = 10.0
MAX_BYTES = 300_000_000
"""Memory limit: more than a class needs that has as many fields as a definition may have."""

bases = st.sampled_from(
    [
        *("bool", "byte", "char", "int8", "uint8", "int16", "uint32", "int64", "uint64", "float32", "float64"),
        *("string", "wstring", "string<=5", "wstring<=1", "A", "B", "C", "fuzz/A", "fuzz/msg/B", "std_msgs/Header"),
        *("Header", "x/Y", "builtin_interfaces/Time", "time", "a", "", "__class__", "A/B/C/D", "�", "Ä", "object"),
        *("self", "/", "int"),
    ]
)
arrays = st.one_of(
    st.sampled_from(
        ["", "", "", "[]", "[3]", "[<=2]", "[0]", "[-1]", "[", "]", "[[]]", "[1_0]", "[<=]", "[ 1]", "[٣]"]
    ),
    st.integers(0, 2**70).map("[{}]".format),
    st.integers(0, 2**70).map("[<={}]".format),
)
names = st.one_of(
    st.sampled_from(
        ["a", "b", "c", "X", "_TYPE", "encode", "decode", "None", "class", "self", "mro", "__init__", "_x"]
    ),
    st.sampled_from(["x__y", "x_", "field", "np", "int", "A", "Message", "_encode", "a.b", "slots", "fill", "message"]),
    st.text(max_size=5),
)
values = st.one_of(
    st.sampled_from(
        ["", " 1", " -1", "=1", "=-1", " = 1.5", "=nan", "=1e999", " []", " [1, 2, 3]", "='", ' "\\', "=True"]
    ),
    st.sampled_from([" [\"a\", 'b']", "='\\x'", '="\\777"', "=\\u12", " [,]", " [[1]]", "=0x", "=1_0", " '\\N{DASH}'"]),
    st.text(max_size=8).map("={}".format),
    st.text(max_size=8).map(" {}".format),
)
comments = st.sampled_from(
    ["", "", "", " # [m]", "#", " # '''", ' # """', " # \\", " # {{ 1 }} {% x %}", "\t# \x0b\x0c\x85"]
)
elements = st.builds("{}{} {}{}{}".format, bases, arrays, names, values, comments)
odd_lines = st.one_of(
    st.sampled_from(
        ["---", "--- ", LINE, "MSG: fuzz/A", "MSG: fuzz/B", "MSG: fuzz/C", "IDL: fuzz/msg/B", "", " ", "#"]
    ),
    st.sampled_from(
        ["MSG: ", "MSG: ..", "MSG: a/b/c/d", "MSG: fuzz/srv/S", "\ufeffint8 x", "@key", "module a {", "};"]
    ),
    st.text(max_size=12),
)
parts = st.builds(
    lambda name, lines: [LINE, f"MSG: {name}", *lines],
    st.sampled_from(["fuzz/A", "fuzz/B", "fuzz/C", "fuzz/srv/S", "fuzz/A_Request", "std_msgs/Header"]),
    st.lists(elements, max_size=4),
)
lines = st.one_of(
    elements.map(lambda line: [line]), elements.map(lambda line: [line]), odd_lines.map(lambda one: [one]), parts
)
good = st.builds(
    "{}{} {}".format,
    st.sampled_from(["int8", "float64", "string", "bool", "wstring", "string<=3", "builtin_interfaces/Time"]),
    st.sampled_from(["", "", "[]", "[2]", "[<=3]"]),
    st.sampled_from(["a", "b", "c", "d", "encode", "decode", "self", "cls", "mro", "np", "message", "raw", "pos"]),
)
sections = st.lists(good, max_size=4, unique_by=lambda line: line.split()[1]).map("\n".join)
good_texts = st.one_of(sections, st.lists(sections, min_size=2, max_size=3).map("\n---\n".join))
wild_texts = st.lists(lines, max_size=10).map(lambda found: "\n".join(line for one in found for line in one))
msg_texts = st.one_of(good_texts, wild_texts)
idl_words = st.sampled_from(
    [
        *("module", "fuzz", "msg", "struct", "A", "B", "{", "}", "};", ";", "<", ">", "(", ")", "[", "]", ",", "="),
        *("::", "@", "long", "short", "sequence", "string", "wstring", "double", "boolean", "octet", "const"),
        *("typedef", "enum", "x", "@key", "@default", "value", "@verbatim", '"text"', "'c'", 'L"w"', "1", "-1"),
        *("1.5", "TRUE", "0x10", "/*", "*/", "//", "\n", "#include", "unsigned", "wchar", "char", "any", "union"),
        *("fixed", "::fuzz::msg::B", "long long", "\\"),
    ]
)
idl_members = st.lists(idl_words, max_size=12).map(" ".join)
idl_texts = st.one_of(
    st.builds("module fuzz {{ module msg {{ struct A {{ {} }}; }}; }};".format, idl_members),
    st.builds("module fuzz {{ module msg {{ struct A {{ long x; {} }}; {} }}; }};".format, idl_members, idl_members),
    st.lists(idl_words, max_size=30).map(" ".join),
)
full_names = st.one_of(
    st.sampled_from(["fuzz/msg/A", "fuzz/A", "fuzz/srv/S", "fuzz/action/C", "fuzz/msg/A_Request", "fuzz/srv/S_Event"]),
    st.sampled_from(
        ["fuzz/action/C_FeedbackMessage", "fuzz/action/C_SendGoal_Request", "std_msgs/msg/Header", "A", "a/b"]
    ),
    st.text(max_size=10),
)
type_ids = st.one_of(st.integers(-2, 300), st.sampled_from([1, 49, 97, 145, 17, 18, 21, 22, 65, 2**40]))
described_types = st.fixed_dictionaries(
    {
        "type_id": type_ids,
        "capacity": st.sampled_from([0, 0, 0, 1, 3, -1, 2**32, 2**64, 2**70]),
        "string_capacity": st.sampled_from([0, 0, 0, 1, 5, -1, 2**64]),
        "nested_type_name": st.sampled_from(
            ["", "", "fuzz/msg/A", "fuzz/msg/B", "fuzz/msg/C", "a/b", "x" * 300, "\udc80"]
        ),
    }
)
described_fields = st.fixed_dictionaries({"name": names, "type": described_types, "default_value": values})
individuals = st.dictionaries(
    st.sampled_from(["fuzz/msg/A", "fuzz/msg/B", "fuzz/msg/C", "fuzz/srv/S_Request", "fuzz/srv/S_Response", "x"]),
    st.lists(described_fields, max_size=4),
    max_size=5,
).map(lambda found: {name: {"type_name": name, "fields": fields} for name, fields in found.items()})
sources = st.dictionaries(
    st.sampled_from(["fuzz/msg/A", "fuzz/msg/B", "fuzz/srv/S"]),
    st.tuples(st.sampled_from(["msg", "srv", "idl", "implicit", ""]), st.one_of(msg_texts, idl_texts)),
    max_size=2,
)


def run_bounded(make: Any) -> Any:
    """Return the result of a call, None for a RosidlError; time and memory must be bounded."""
    start = time.process_time()
    tracemalloc.start()
    try:
        return make()
    except RosidlError as error:
        assert str(error).strip() and len(str(error)) < 100_000
        return None
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert time.process_time() - start < MAX_S
        assert peak < MAX_BYTES, peak


def used(cls: Any) -> None:
    if cls is None or not hasattr(cls, "encode"):
        return

    def use() -> None:
        value = cls()
        assert encode(decode(cls, encode(value))) == encode(value)
        from_dict(cls, to_dict(value))
        again = compile_definition(type_name(cls), definition_text(cls))
        assert type_hash(again) == type_hash(cls)

    run_bounded(use)


class Definitions(RuleBasedStateMachine):
    """Definitions from texts, bags, bytes and descriptions of nodes."""

    def __init__(self) -> None:
        super().__init__()
        self.decoders = DecoderFactory()
        self.made: list[Any] = []

    def _keep(self, cls: Any) -> None:
        used(cls)
        if cls is not None:
            self.made.append(cls)

    @rule(name=full_names, text=st.one_of(msg_texts, idl_texts))
    def compile(self, name: str, text: str) -> None:
        self._keep(run_bounded(lambda: compile_definition(name, text)))

    @rule(name=full_names, text=st.one_of(msg_texts, idl_texts), encoding=st.sampled_from(["ros2msg", "ros2idl", "x"]))
    def read_a_bag(self, name: str, text: str, encoding: str) -> None:
        schema: Any = SimpleNamespace(name=name, data=text.encode("utf-8", "surrogatepass"), encoding=encoding)
        found = run_bounded(lambda: self.decoders.decoder_for("cdr", schema))
        if found is not None:
            run_bounded(lambda: found(b"\0\1\0\0" + bytes(64)))

    @rule(name=full_names, data=st.binary(max_size=60))
    def read_bytes(self, name: str, data: bytes) -> None:
        run_bounded(lambda: self.decoders.decoder_for("cdr", SimpleNamespace(name=name, data=data, encoding="ros2msg")))  # type: ignore[arg-type]

    @rule(name=full_names, announced=individuals, texts=sources, is_service=st.booleans())
    def compile_announced_type(self, name: str, announced: Any, texts: Any, is_service: bool) -> None:
        self._keep(run_bounded(lambda: DescribedType(name, announced, texts, is_service=is_service).load()))

    @precondition(lambda self: self.made)
    @rule(data=st.data(), change=st.tuples(st.integers(0, 200), st.text(max_size=3)))
    def compile_damaged_text_again(self, data: st.DataObject, change: tuple[int, str]) -> None:
        cls = data.draw(st.sampled_from(self.made))
        text = run_bounded(lambda: definition_text(cls))
        if text is not None:
            place = change[0] % (len(text) + 1)
            self._keep(
                run_bounded(lambda: compile_definition(type_name(cls), text[:place] + change[1] + text[place + 1 :]))
            )
        run_bounded(lambda: DescribedType(type_name(cls), TypeDescriptions.by_name(type_description(cls))).load())


TestDefinitions = Definitions.TestCase
TestDefinitions.settings = settings(
    max_examples=examples(60),
    stateful_step_count=12,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much],
)


@pytest.mark.parametrize(("name", "text"), [("fuzz/srv/S", "int8 a\n---\n"), ("fuzz/action/C", "---\n---\nint8 a\n")])
def test_decoder_factory_refuses_the_schema_of_a_service_or_action(name: str, text: str) -> None:
    schema: Any = SimpleNamespace(name=name, data=text.encode(), encoding="ros2msg")
    with pytest.raises(DefinitionError, match="the schema defines a service or action; expected a message"):
        DecoderFactory().decoder_for("cdr", schema)


@pytest.mark.parametrize("arrays", [False, True])
def test_message_with_a_field_named_decode_is_decoded(arrays: bool) -> None:
    schema: Any = SimpleNamespace(name="fuzz/msg/Taken", data=b"int8 decode\nint8 encode\n", encoding="ros2msg")
    decoder = DecoderFactory(arrays=arrays).decoder_for("cdr", schema)
    assert decoder is not None
    assert decoder(b"\0\1\0\0\5\6").decode == 5
