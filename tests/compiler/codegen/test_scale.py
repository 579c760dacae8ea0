"""Hostile definitions: cost in proportion to the definition, or an error that states the limit."""

from __future__ import annotations

import gc
import sys
import time
from itertools import count

import pytest

from rosidl_py_gen import DefinitionError, compile_definition, decode, encode, type_hash
from rosidl_py_gen.compiler.frontend.size_limits import MAX_FIELDS, MAX_TYPES, MAX_VALUES

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
    small, large = ("".join(KINDS[kind].format(i) for i in range(n)) for n in (1005, 2010))
    below = "int32 x\nstring s\n"
    steps(small, below)
    assert steps(large, below) < 2.2 * steps(small, below)


def test_compile_time_of_many_fields_is_not_quadratic() -> None:
    """A profile does not count this: CPython binds keyword arguments by a search of all parameters for each."""
    small, large = ("".join(f"int32 f{i}\n" for i in range(n)) for n in (2000, 16_000))
    seconds(small)
    # Measured alternately, because other programs of the machine make a measurement slower.
    ratios = (seconds(large) / min(seconds(small), seconds(small)) for _ in range(3))
    assert any(ratio < 8 * 2.5 for ratio in ratios)


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
        inner.a = [type(inner)._TYPE.fields[0].cls()]
        inner = inner.a[0]
    inner.x = -5
    assert decode(cls, encode(value)) == value


def test_class_with_very_many_fields_is_constructed_like_any_other() -> None:
    name = package()
    text = "".join(f"int32 f{i} {i}\n" for i in range(1200)) + "float64[] last\n"
    cls = compile_definition(f"{name}/T0", text)
    assert (cls().f7, cls(1, f7=5).f0, cls(1, f7=5).f7, len(cls().last)) == (7, 1, 5, 0)
    assert cls().last is not cls().last
    assert decode(cls, encode(cls(f9=-3))) == cls(f9=-3)
    with pytest.raises(TypeError, match="unexpected keyword argument 'g'"):
        cls(g=1)
    with pytest.raises(TypeError, match="two values for 'f0'"):
        cls(1, f0=1)
    with pytest.raises(TypeError, match="takes 1201 values, found 1202"):
        cls(*range(1202))


REFUSED = {
    "doubling": (chain(30, "T a\nT b\n"), rf"T\d+>:2:\d+: .* values in .* at most {MAX_VALUES} are allowed"),
    "an array of messages": (("T1[2000000] a\n", "int32 x\n"), r"T0>:1:13: .* has 2000001 values in"),
    "arrays in arrays": (chain(7, "T[10] a\n"), rf">:1:\d+: .* values in .*, at most {MAX_VALUES}"),
    "strings": (("int32 a\nstring[2000000] b\n",), r"T0>:2:17: .* has 2000002 values in"),
    "bytes": (("uint8 a\nuint8[4294967295] b\n",), r"T0>:2:19: .* has 4294967296 bytes in fixed arrays up to here"),
    "bytes in messages": (("T1[300] a\n", "float64[1000000] b\n"), r"T0>:1:9: .* has 2400000000 bytes in fixed"),
    "fields": (("".join(f"uint8 f{i}\n" for i in range(60_000)),), rf"T0>:{MAX_FIELDS + 1}:7: .* fields with"),
    "fields of messages": (
        ("".join(f"T1 f{i}\n" for i in range(1000)), "".join(f"uint8 f{i}\n" for i in range(40))),
        rf"T0>:500:4: .* has {MAX_FIELDS + 40} fields with those of nested messages up to here, at most {MAX_FIELDS}",
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
    cls = compile_definition(f"{name}/T0", text_of(name, "".join(f"T1 p{i}\nT1[] q{i}\n" for i in range(800)), pose))
    assert len(cls._TYPE.fields) == 1600
    assert type_hash(cls).startswith("RIHS01_")
    image = compile_definition(f"{name}/T2", "uint8[99532800] data\n")  # 7680 x 4320 x 3
    assert image._TYPE.fields[0].type.capacity == 99_532_800
