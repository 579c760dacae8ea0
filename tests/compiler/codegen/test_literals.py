"""Values and docstrings, the two places where text of a definition becomes source text, and names in a module."""

from __future__ import annotations

import ast
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.example_counts import examples
from support.interface_packages import assert_clean, write

from rosidl_py_gen.compiler.codegen.naming import Imports, Locals, singular, sort_key
from rosidl_py_gen.compiler.codegen.python_literals import docstring, py_literal, py_string, visible

NASTY = st.text(st.sampled_from("ab \"'\\\n\r\t\0\x1b{}%#é ハ😀\u2028\u202e\ufeff\x85nxuN01"), max_size=30)
TEXT = st.one_of(st.text(max_size=40), NASTY)


@settings(max_examples=examples(500), deadline=None)
@given(TEXT)
def test_a_string_literal_means_the_string(text: str) -> None:
    literal = py_string(text)
    assert ast.literal_eval(literal) == text
    assert literal.isprintable()
    assert len(literal.splitlines()) == 1


@pytest.mark.parametrize(
    ("text", "literal"),
    [
        ("", '""'),
        ("plain", '"plain"'),
        ("it's", '"it\'s"'),
        ('say "x"', "'say \"x\"'"),
        ("both \" and '", '"both \\" and \'"'),
        ("a\\b", '"a\\\\b"'),
        ("tab\tline\n", '"tab\\tline\\n"'),
        ("\0\x1b", '"\\x00\\x1b"'),
        ("é ハ 😀", '"é ハ 😀"'),
        ("\u202e\ufeff", '"\\u202e\\ufeff"'),
        ("\U000e0041", '"\\U000e0041"'),
        ("{{ x }} {% y %}", '"{{ x }} {% y %}"'),
    ],
)
def test_string_literals_look_like_this(text: str, literal: str) -> None:
    assert py_string(text) == literal


@pytest.mark.parametrize(
    ("value", "literal"),
    [
        (True, "True"),
        (0, "0"),
        (-5, "-5"),
        (2**64 - 1, "18446744073709551615"),
        (1.0, "1.0"),
        (1e-5, "1e-05"),
        (1e16, "1e16"),
        (-1.5e300, "-1.5e300"),
        (-0.0, "-0.0"),
        (math.inf, 'float("inf")'),
        (-math.inf, 'float("-inf")'),
        (math.nan, 'float("nan")'),
    ],
)
def test_other_literals_look_like_this(value: bool | int | float, literal: str) -> None:
    assert py_literal(value) == literal


@given(st.one_of(st.booleans(), st.integers(), st.floats(allow_nan=False)))
def test_a_literal_means_the_value(value: bool | int | float) -> None:
    found = eval(py_literal(value), {"__builtins__": {"float": float}})
    assert (type(found), repr(found)) == (type(value), repr(value))


def body(doc: str) -> ast.Module:
    return ast.parse(f"class A:\n    {doc}\n    x = 1\n")


@settings(max_examples=examples(500), deadline=None)
@given(st.lists(TEXT, max_size=4))
def test_a_docstring_stays_a_docstring(lines: list[str]) -> None:
    (cls,) = body(docstring(lines, "    ")).body
    assert isinstance(cls, ast.ClassDef)
    text, assignment = cls.body
    assert isinstance(assignment, ast.Assign)
    assert isinstance(text, ast.Expr)
    assert isinstance(text.value, ast.Constant)
    assert isinstance(text.value.value, str)
    for line in lines:
        if line.isascii() and line.isprintable():
            assert " ".join(line.split()) in " ".join(text.value.value.split())


@pytest.mark.hypothesis  # the plugin marks only what is @given itself
def test_docstrings_of_any_text_are_left_alone_by_the_formatter(tmp_path: object) -> None:
    found: list[str] = []

    @settings(max_examples=examples(300), deadline=None, database=None)
    @given(
        st.lists(
            st.one_of(TEXT, st.sampled_from(["", " ", "  two", "    four", '"', '"a"', "\\", "'''", "a\\"])), max_size=4
        )
    )
    def collect(lines: list[str]) -> None:
        if visible(tuple(lines)):
            found.append(docstring(lines, "    "))

    collect()
    from pathlib import Path

    folder = Path(str(tmp_path)) / "out"
    write(folder, {"docs.py": "\n\n".join(f"class A{i}:\n    {doc}\n\n    x = 1\n" for i, doc in enumerate(found))})
    assert_clean(folder)


# --- names inside a module --------------------------------------------------------------------------------------------


def test_imports_step_aside_for_fields_and_classes() -> None:
    imports = Imports(frozenset({"Time", "_Time"}), frozenset({"np", "int"}))
    assert imports.use_numpy() == "_np"
    assert imports.use("a_msgs.msg._time", "Time") == "_a_msgs_msg__time_Time"
    assert imports.use("b_msgs.msg._date", "Date") == "Date"
    assert imports.use("c_msgs.msg._date", "Date") == "_Date"
    assert imports.use("b_msgs.msg._date", "Date") == "Date"
    assert (imports.builtin("int"), imports.builtin("str")) == ("_int", "str")
    assert imports.lines() == [
        "from a_msgs.msg._time import Time as _a_msgs_msg__time_Time",
        "from b_msgs.msg._date import Date",
        "from builtins import int as _int",
        "from c_msgs.msg._date import Date as _Date",
        "import numpy as _np",
    ]


def test_names_of_one_module_are_imported_together() -> None:
    imports = Imports(frozenset({"Message", "Action"}), frozenset())
    for name in ("recover", "Message", "TypeInfo", "Action", "CONSTANT"):
        imports.use("rosidl_py_gen.cdr", name)
    assert imports.lines() == [
        "from rosidl_py_gen.cdr import Action as _Action, CONSTANT, Message as _Message, TypeInfo, recover"
    ]


def test_locals_hide_nothing() -> None:
    names = Locals()
    assert [names.name(word) for word in ("pose", "pose", "pose", "self", "len", "from", "raw", "x" * 99)] == [
        "pose",
        "pose_",
        "pose_2",
        "self_",
        "len_",
        "from_",
        "raw_",
        "x" * 28,
    ]


@pytest.mark.parametrize(
    ("name", "one"),
    [("poses", "pose"), ("data", "data_item"), ("mass", "mass_item"), ("s", "s_item"), ("is", "is_item")],
)
def test_an_element_is_named_after_its_field(name: str, one: str) -> None:
    assert singular(name) == one


def test_names_are_sorted_as_formatters_do() -> None:
    words = ["b", "a10", "a9", "Time", "UUID", "Int8", "A", "FLOAT64", "FLOAT8"]
    assert sorted(words, key=sort_key) == ["FLOAT8", "FLOAT64", "UUID", "A", "Int8", "Time", "a9", "a10", "b"]
