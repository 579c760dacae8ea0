"""Values and docstrings, the two places where text of a definition becomes source text."""

from __future__ import annotations

import ast
import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.example_counts import examples
from support.interface_packages import assert_clean, write

from rosidl_py_gen.compiler.codegen.python_text import docstring, py_literal, py_string, visible

NASTY = st.text(st.sampled_from("ab \"'\\\n\r\t\0\x1b{}%#é ハ😀\u2028\u202e\ufeff\x85nxuN01"), max_size=30)
TEXT = st.one_of(st.text(max_size=40), NASTY)


@settings(max_examples=examples(500), deadline=None)
@given(TEXT)
def test_string_literal_evaluates_to_the_string(text: str) -> None:
    literal = py_string(text)
    assert ast.literal_eval(literal) == text
    assert literal.isprintable()
    assert len(literal.splitlines()) == 1


@example(math.nan)
@example(-math.inf)
@given(st.one_of(st.booleans(), st.integers(), st.floats()))
def test_literal_evaluates_to_the_value(value: bool | int | float) -> None:
    found = eval(py_literal(value), {"__builtins__": {"float": float}})
    assert (type(found), repr(found)) == (type(value), repr(value))


def body(doc: str) -> ast.Module:
    return ast.parse(f"class A:\n    {doc}\n    x = 1\n")


@settings(max_examples=examples(500), deadline=None)
@given(st.lists(TEXT, max_size=4))
def test_docstring_of_any_text_remains_a_docstring(lines: list[str]) -> None:
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


@pytest.mark.slow
@pytest.mark.hypothesis  # the plugin marks only tests that are @given themselves
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
