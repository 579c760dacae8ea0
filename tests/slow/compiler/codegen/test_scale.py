"""Hostile definitions: cost in proportion to the definition, or an error that states the limit."""

from __future__ import annotations

import gc
import sys
import time
from itertools import count

import pytest
from support.inner_state import type_fields

from rosidl_py_gen import DefinitionError, compile_definition, decode, encode, from_json, to_json, type_hash
from rosidl_py_gen.compiler.frontend.size_limits import MAX_ELEMENTS, MAX_FIELDS, MAX_TYPES, MAX_VALUES

_LINE = "=" * 80
_numbers = count()


def package() -> str:
    """Return a package name that no other test uses, so that no class is cached."""
    return f"scale{next(_numbers)}_msgs"


def text_of(package: str, *bodies: str) -> str:
    """Return the definitions of types T0, T1, ... as one text."""
    return bodies[0] + "".join(f"{_LINE}\nMSG: {package}/T{i}\n{body}" for i, body in enumerate(bodies) if i)


def chain(levels: int, field: str) -> tuple[str, ...]:
    """Return bodies of types, each with `field` of the next type."""
    return (*(field.replace("T", f"T{i + 1}") for i in range(levels)), "int32 x\n")


def steps(*bodies: str) -> int:
    """Count function calls and returns while a class is made; unlike time, equal in every run."""
    name = package()
    text = text_of(name, *bodies)
    done = 0

    def note(*_: object) -> None:
        nonlocal done
        done += 1

    sys.setprofile(note)
    try:
        compile_definition(f"{name}/T0", text)
    finally:
        sys.setprofile(None)
    return done


def seconds(*bodies: str) -> float:
    """Processor time of making a class, without garbage collections, which grow with all that earlier tests left."""
    name = package()
    text = text_of(name, *bodies)
    gc.collect()
    gc.disable()
    try:
        start = time.process_time()
        compile_definition(f"{name}/T0", text)
        return time.process_time() - start
    finally:
        gc.enable()


KINDS = {
    "numbers": "int32 f{}\n",
    "strings": "string f{}\n",
    "sequences": "float64[] f{}\n",
    "arrays": "float64[3] f{}\n",
    "long names": "int32 a_name_that_is_longer_than_a_local_name_{}\n",
    "messages": "T1 f{}\n",
}


@pytest.mark.parametrize("kind", KINDS)
def test_compile_steps_grow_linearly_with_the_number_of_fields(kind: str) -> None:
    small, large = ("".join(KINDS[kind].format(i) for i in range(n)) for n in (300, 600))
    below = "int32 x\nstring s\n"
    steps(small, below)
    assert steps(large, below) < 2.2 * steps(small, below)


@pytest.mark.parametrize("field", ["int32 f{}\n", "string<=5[<=3] f{}\n"])
def test_message_with_the_maximum_of_fields_is_compiled_within_seconds(field: str) -> None:
    """A profile does not count this: the constructor of a dataclass takes time by the square of the fields."""
    assert seconds("".join(field.format(i) for i in range(MAX_ELEMENTS))) < 8


@pytest.mark.parametrize("field", ["T a\n", "T[2] a\n", "T[] a\n", "T[<=3] a\n", "T a\nT b\n"])
def test_compile_steps_of_nested_types_grow_less_than_quadratically(field: str) -> None:
    """A naive planner visits a level four times for each level above; CPython refuses 21 nested loops."""
    if field.startswith(("T[2]", "T a\nT")):  # a new T0 is twice as large for each level
        assert steps(*chain(18, field)) < 4 * steps(*chain(9, field))
    else:
        assert steps(*chain(50, field)) < 4 * steps(*chain(25, field))


def test_compile_steps_of_densely_connected_types_grow_linearly() -> None:
    def layers(depth: int) -> list[str]:
        bodies = ["T1[] a\n"]
        for level in range(depth):
            below = [f"T{1 + (level + 1) * 4 + k}[] f{k}\n" for k in range(4)] if level < depth - 1 else ["int32 x\n"]
            bodies += ["".join(below)] * 4
        return bodies

    assert steps(*layers(20)) < 2.5 * steps(*layers(10))


def test_messages_nested_ninety_levels_deep_round_trip() -> None:
    name = package()
    cls = compile_definition(f"{name}/T0", text_of(name, *chain(90, "T[] a\nuint8 b\n")))
    value = inner = cls()
    while hasattr(inner, "a"):
        inner.b = 7
        inner.a = [type_fields(type(inner))[0].cls()]
        inner = inner.a[0]
    inner.x = -5
    assert decode(cls, encode(value)) == value


def test_message_with_the_maximum_of_fields_works_like_any_other() -> None:
    name = package()
    text = "".join(f"int32 f{i} {i}\n" for i in range(MAX_ELEMENTS - 2)) + "float64[] last\nint8 A=1\n"
    cls = compile_definition(f"{name}/T0", text)
    assert (cls().f7, cls(1, f7=5).f0, cls(1, f7=5).f7, len(cls().last), cls.A) == (7, 1, 5, 0, 1)
    assert cls().last is not cls().last
    assert decode(cls, encode(cls(f9=-3))) == cls(f9=-3) == from_json(cls, to_json(cls(f9=-3)))


REFUSED = {
    "doubling": (chain(30, "T a\nT b\n"), rf"T\d+>:2:\d+: .* values in .* at most {MAX_VALUES} are allowed"),
    "an array of messages": (("T1[2000000] a\n", "int32 x\n"), r"T0>:1:13: .* has 2000001 values in"),
    "arrays in arrays": (chain(7, "T[10] a\n"), rf">:1:\d+: .* values in .*, at most {MAX_VALUES}"),
    "strings": (("int32 a\nstring[2000000] b\n",), r"T0>:2:17: .* has 2000002 values in"),
    "bytes": (("uint8 a\nuint8[4294967295] b\n",), r"T0>:2:19: .* has 4294967296 bytes in fixed arrays up to here"),
    "bytes in messages": (("T1[300] a\n", "float64[1000000] b\n"), r"T0>:1:9: .* has 2400000000 bytes in fixed"),
    "fields": (
        ("".join(f"uint8 f{i}\n" for i in range(60_000)),),
        rf"T0>:{MAX_ELEMENTS + 1}:7: .* has {MAX_ELEMENTS + 1} fields .* up to here, at most {MAX_ELEMENTS} are "
        "allowed; split it into several messages, or use arrays",
    ),
    "fields of messages": (
        ("".join(f"T1 f{i}\n" for i in range(1000)), "".join(f"uint8 f{i}\n" for i in range(40))),
        r"T0>:49:4: .* has 2009 fields \(with the fields of nested messages\), constants and default values up to here",
    ),
    "fields of messages in each other": (
        ("".join(f"T1 f{i}\n" for i in range(1000)), *chain(9, "T a\n")[1:]),
        r"T0>:201:4: .* has 2010 fields \(with the fields of nested messages\)",
    ),
    "constants": (
        ("int8 a\n" + "".join(f"int8 A{i}=1\n" for i in range(3000)),),
        rf"T0>:{MAX_ELEMENTS + 2}:6: .* has 3000 fields .*, at most {MAX_ELEMENTS} are allowed; split",
    ),
    "default values": (
        ("int8 a\nint8[] b [1" + ",1" * 3000 + "]\n",),
        rf"T0>:2:8: .* has 3003 fields .*, constants and default values up to here, at most {MAX_ELEMENTS}",
    ),
    "fields of all types": (
        ("".join(f"T{i} f{i}\n" for i in range(1, 7)), *["".join(f"uint8 f{i}\n" for i in range(1900))] * 6),
        rf"T0>:6:4: .* has 11406 fields with the fields of nested messages up to here, at most {MAX_FIELDS}",
    ),
    "types": (
        ("".join(f"T{i} f{i}\n" for i in range(1, 600)), *["uint8 x\n"] * 600),
        rf"T0>:{MAX_TYPES + 1}:\d+: .* has {MAX_TYPES + 1} types that it refers to",
    ),
    "levels": (chain(102, "T[] a\n"), "types are nested deeper than 100 levels here"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_too_large_definition_is_refused_with_limit_location_and_size(case: str) -> None:
    bodies, words = REFUSED[case]
    name = package()
    start = time.process_time()
    with pytest.raises(DefinitionError, match=words) as caught:
        compile_definition(f"{name}/T0", text_of(name, *bodies))
    assert time.process_time() - start < 5
    assert len(caught.value.diagnostics) == 1 or case == "levels"


def test_messages_of_one_definition_share_the_limit_of_elements() -> None:
    section, other = ("".join(f"uint8 {name}{i}\n" for i in range(900)) for name in "fg")
    assert compile_definition(f"{package()}/srv/S", f"{section}---\n{section}")
    with pytest.raises(DefinitionError, match=r"S>:902:7: .*/srv/S has 2700 .* S_Response, at most 2000 are"):
        compile_definition(f"{package()}/srv/S", f"{section}---\n{section}{other}")
    with pytest.raises(DefinitionError, match=r"A>:1803:7: .*/action/A has 27\d\d .* A_Feedback, at most 2000 are"):
        compile_definition(f"{package()}/action/A", f"{section}---\n{section}---\n{section}")


@pytest.mark.parametrize("line", ["Unknown{} x{}\n", "uint8 X{}{}\n", "no type{}{}\n", "uint8 x\n"])
def test_only_the_first_hundred_errors_of_a_definition_are_reported(line: str) -> None:
    name = package()
    start = time.process_time()
    with pytest.raises(DefinitionError) as caught:
        compile_definition(f"{name}/T0", "".join(line.format(i, i) for i in range(30_000)))
    assert time.process_time() - start < 5
    assert len(caught.value.diagnostics) == 101
    assert "there are more problems; the first 100 are shown" in str(caught.value)


def test_large_realistic_definitions_are_accepted() -> None:
    name = package()
    pose = "float64[3] position\nfloat64[4] orientation\nfloat64[36] covariance\nstring frame\n"
    cls = compile_definition(f"{name}/T0", text_of(name, "".join(f"T1 p{i}\nT1[] q{i}\n" for i in range(190)), pose))
    assert len(type_fields(cls)) == 380
    assert type_hash(cls).startswith("RIHS01_")
    image = compile_definition(f"{name}/T2", "uint8[99532800] data\n")  # 7680 x 4320 x 3
    assert type_fields(image)[0].type.capacity == 99_532_800
