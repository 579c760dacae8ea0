"""Random worlds of message definitions, and random values for them.

A world is a few messages in two packages that use each other, as a person with bad taste could have written them:
fields named after keywords, builtins and our own helpers, every type in every arity, defaults, constants, empty
messages, and messages of so many fields that their code is not printed in line.
"""

from __future__ import annotations

import functools
import hashlib
import math
import struct
from dataclasses import dataclass
from typing import Any

from hypothesis import strategies as st

from rosidl_py_gen import compile_definition
from rosidl_py_gen.base.fieldtype import PRIMITIVES, Arity, FieldType
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.compiler.frontend.model import SourceText
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry, check
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from support.reference_cdr import NUMBERS, Reference

FLOATS = ("float32", "float64")

# Names that may collide in generated code: keywords, builtins, internals without dunders, parameters and locals.
NASTY = (
    *("encode", "decode", "data", "self", "cls", "field", "list", "np", "int", "bytes", "bool", "str", "float"),
    *("from", "class", "import", "pass", "lambda", "def", "none", "async", "print", "type", "len", "range", "copy"),
    *("pos", "parts", "append", "end", "raw", "view", "message", "new", "limit", "within", "utf8", "frombuffer"),
    *("classmethod", "memoryview", "dataclass", "object", "tuple", "x", "value", "values", "error", "module", "fields"),
    *("encode_slow", "decode_slow", "pos2", "x_count", "x_item", "bytearray", "expect", "exactly", "builtins"),
)
CONSTANTS = ("LIMIT", "BOOL", "T", "PAD4", "A_1", "TYPE_CHECKING", "UINT8", "FLOAT64")
SAFE = tuple(f"{word}_{number}" for number in range(8) for word in ("alpha", "beta", "gamma", "delta"))
TYPE_NAMES = (
    "Alpha",
    "Message",
    "TypeInfo",
    "ClassVar",
    "None",
    "ValueError",
    "NDArray",
    "Exception",
    "Struct",
    "Self",
)
SAFE_TYPE_NAMES = ("Alpha", "Beta", "Gamma", "Delta", "Epsilon")

_PACKAGES = ("<first>", "<second>")  # replaced by names made from the content, so that equal names mean equal text


@dataclass(frozen=True)
class World:
    """Definitions in dependency order; the last one is the top, which uses some of the others.

    Attributes:
        texts: full name and .msg text.
        defaults: what a new message of the top type holds in the fields that have an explicit default.
    """

    texts: tuple[tuple[str, str], ...]
    defaults: tuple[tuple[str, Any], ...]

    @property
    def top(self) -> str:
        return self.texts[-1][0]

    @property
    def text(self) -> str:
        """Return the ros2msg text of the top type."""
        parts = [self.texts[-1][1]]
        for name, text in self.texts[:-1]:
            parts.append("=" * 80 + f"\nMSG: {name.replace('/msg/', '/')}\n{text}")
        return "\n".join(parts)

    def compile(self) -> type[Any]:
        return compile_definition(self.top, self.text)

    def reference(self) -> Reference:
        library = InterfaceRegistry(SearchPath({}, [], []))
        for name, text in self.texts:
            library.add_text(RosName.parse(name), SourceText(f"<{name}>", text, "msg"))
        check(library, [RosName.parse(name) for name, _ in self.texts])
        library.raise_diagnostics()
        return Reference(library.message)

    def __repr__(self) -> str:
        return f"World({self.top!r}):\n{self.text}"


# --- values -----------------------------------------------------------------------------------------------------------


# Strategies are made once: making one takes longer than drawing from it.


@functools.cache
def numbers(kind: str) -> st.SearchStrategy[Any]:
    """Return a strategy for scalars of a primitive type."""
    if kind == "bool":
        return st.booleans()
    if kind in FLOATS:
        return st.floats(width=8 * NUMBERS[kind][1])
    low, high = PRIMITIVES[kind].integer_range
    return st.one_of(st.integers(low, high), st.sampled_from((low, high)))


@functools.cache
def texts(bound: int = 0) -> st.SearchStrategy[str]:
    """A string: NULs, quotes and characters outside the basic plane included, lone surrogates not."""
    return st.text(st.characters(exclude_categories=("Cs",)), max_size=min(bound, 12) if bound else 12)


@st.composite
def _many_numbers(draw: st.DrawFn, kind: str, count: int | None, most: int) -> list[Any]:
    size = draw(_up_to(min(most, 9))) if count is None else count
    letter, width = NUMBERS[kind]
    if size <= 9:
        return [draw(numbers(kind)) for _ in range(size)]
    block = draw(_bytes(width * 8))
    items = [value != 0 for value in block[:8]] if kind == "bool" else list(struct.unpack(f"<8{letter}", block))
    return (items * (size // 8 + 1))[:size]


@functools.cache
def many_numbers(kind: str, count: int | None, most: int) -> st.SearchStrategy[list[Any]]:
    """A numeric list: short ones element by element, long ones from raw bytes."""
    return _many_numbers(kind, count, most)


@functools.cache
def _up_to(most: int, least: int = 0) -> st.SearchStrategy[int]:
    return st.integers(least, most)


@functools.cache
def _some(of: st.SearchStrategy[Any], least: int, most: int) -> st.SearchStrategy[list[Any]]:
    return st.lists(of, min_size=least, max_size=most)


@functools.cache
def _bytes(size: int) -> st.SearchStrategy[bytes]:
    return st.binary(min_size=size, max_size=size)


@functools.cache
def _one_of(*what: Any) -> st.SearchStrategy[Any]:
    return st.sampled_from(what)


@functools.cache
def _different(of: tuple[str, ...], count: int) -> st.SearchStrategy[list[str]]:
    return st.lists(st.sampled_from(of), min_size=count, max_size=count, unique=True)


@functools.cache
def _in_any_order(of: tuple[str, ...]) -> st.SearchStrategy[list[str]]:
    return st.permutations(of)


_YES_OR_NO = st.booleans()


@st.composite
def values(draw: st.DrawFn, reference: Reference, name: str) -> dict[str, Any]:
    """Draw a plain value of a message."""
    result: dict[str, Any] = {}
    for item in reference.definition(name).fields:
        result[item.name] = draw(_value(reference, item.type))
    return result


def _value(reference: Reference, kind: FieldType) -> st.SearchStrategy[Any]:
    count = kind.capacity if kind.arity is Arity.ARRAY else None
    most = kind.capacity if kind.arity is Arity.BOUNDED else 5
    if kind.base in NUMBERS:
        return numbers(kind.base) if kind.arity is Arity.SCALAR else many_numbers(kind.base, count, most)
    one = texts(kind.string_bound) if kind.is_string else values(reference, kind.base)
    if kind.arity is Arity.SCALAR:
        return one
    some = _some if kind.is_string else _some.__wrapped__  # those of messages are drawn from once
    return some(one, count or 0, count if count is not None else min(most, 3))


# --- definitions ------------------------------------------------------------------------------------------------------


@dataclass
class _Made:
    """A message so far: its text, and the leaves one instance holds at least (bounds the size of values)."""

    name: str
    leaves: int


@st.composite
def worlds(draw: st.DrawFn, *, nasty: bool = True, wide: bool = True, exotic: bool = True) -> World:
    """A world.

    Args:
        nasty: names and text a generator could trip over; without it every generator of the world should cope.
        wide: wstrings too.
        exotic: bounded strings, empty messages and defaults too.
    """
    made: list[_Made] = []
    bodies: list[str] = []
    owners: list[str] = []
    defaults: dict[str, Any] = {}
    type_names = draw(_in_any_order(tuple(TYPE_NAMES if nasty else SAFE_TYPE_NAMES)))
    for index in range(draw(_up_to(4, 1))):
        package = draw(_one_of(*_PACKAGES))
        body, leaves, defaults = draw(_body(package, made, nasty, wide, exotic))
        name = type_names[index // 2] if nasty and index and owners[-1] != package else type_names[index + 1]
        if any(one.name == f"{package}/{name}" for one in made):
            name = f"{name}{index}"
        made.append(_Made(f"{package}/{name}", leaves))
        bodies.append(body)
        owners.append(package)
    digest = hashlib.sha256("\0".join([*bodies, *(one.name for one in made)]).encode("utf-8", "replace")).hexdigest()

    def named(text: str) -> str:
        return text.replace("<first>", f"p{digest[:16]}").replace("<second>", f"q{digest[:16]}")

    full = [named(one.name).replace("/", "/msg/") for one in made]
    return World(tuple(zip(full, map(named, bodies), strict=True)), tuple(defaults.items()))


@st.composite
def _body(
    draw: st.DrawFn, package: str, made: list[_Made], nasty: bool, wide: bool, exotic: bool
) -> tuple[str, int, dict[str, Any]]:
    heavy = draw(_up_to(9)) == 9
    count = draw(_up_to(7, 0 if exotic else 1)) + (50 if heavy else 0)
    names = draw(_different((*NASTY, *SAFE) if nasty else tuple(SAFE), min(count, 7)))
    names += [f"more_{number}" for number in range(count - len(names))]
    lines: list[str] = []
    leaves = 1
    defaults: dict[str, Any] = {}
    if nasty and draw(_YES_OR_NO):
        lines += [draw(_comment()), f"uint8 {draw(_one_of(*CONSTANTS))}=7"]
    for position, name in enumerate(names):
        if position >= 7:  # the bulk of a heavy message
            lines.append(f"{draw(_one_of('uint8', 'float64', 'int16', 'bool'))} {name}")
            leaves += 1
            continue
        text, one, default, value = draw(_field(package, made, leaves, wide, exotic))
        lines.append(f"{text} {name}{' ' if default else ''}{default}")
        if default:
            defaults[name] = value
        if nasty and draw(_up_to(7)) == 7:
            lines[-1] += "  " + draw(_comment())
        leaves += one
    return "\n".join(lines) + "\n", leaves, defaults


@functools.cache
def _comment() -> st.SearchStrategy[str]:
    pieces = (
        '"""',
        "\\",
        "{{ x }}",
        "{% raw %}",
        "'",
        "[m/s]",
        "text",
        "\x00",
        "#",
        "é",
        "${a}",
        "%s",
        "\\N{DASH}",
        "",
    )
    return st.lists(st.sampled_from(pieces), max_size=4).map(lambda parts: "# " + " ".join(parts))


@st.composite
def _field(
    draw: st.DrawFn, package: str, made: list[_Made], used: int, wide: bool, exotic: bool
) -> tuple[str, int, str, Any]:
    """The text of a type, the leaves it adds, the text of its default and what that means."""
    arity = draw(_one_of("", "", "[n]", "[]", "[<=n]"))
    small = [one for one in made if one.leaves <= 40]
    what = draw(_up_to(9))
    if small and what >= 6:
        target = small[draw(_up_to(len(small) - 1))]
        most = max(1, min(3, 60 // target.leaves))
        size = draw(_up_to(most, 1))
        owner, _, short = target.name.partition("/")
        base = short if owner == package and draw(_YES_OR_NO) else f"{owner}/{short}"
        return base + arity.replace("n", str(size)), target.leaves * (size if arity == "[n]" else 1), "", None
    if what >= 4:
        base = draw(_one_of("string", "wstring") if wide else _one_of("string"))
        bound = draw(_one_of(0, 0, 1, 5)) if exotic else 0
        size = draw(_up_to(3, 1))
        text = f"{base}<={bound}" if bound else base
        if exotic and not arity and not bound and draw(_YES_OR_NO):
            value = draw(_one_of("", "plain", "it's {x} %s", "é€"))
            return text, 1, f'"{value}"', value
        return text + arity.replace("n", str(size)), size, "", None
    base = draw(_one_of(*NUMBERS))
    size = draw(_one_of(1, 2, 3, 3, 5, 9, 16, 129, 1025))
    text = base + arity.replace("n", str(size))
    if exotic and size <= 5 and draw(_YES_OR_NO):
        if not arity:
            value = draw(_finite(base))
            return text, 1, _spelled(value), value
        number = size if arity == "[n]" else draw(_up_to(size))
        value = [draw(_finite(base)) for _ in range(number)]
        return text, 1, "[" + ", ".join(map(_spelled, value)) + "]", value
    return text, 1, "", None


@functools.cache
def _finite(kind: str) -> st.SearchStrategy[Any]:
    return numbers(kind).filter(lambda value: not isinstance(value, float) or math.isfinite(value))


def _spelled(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(value)
