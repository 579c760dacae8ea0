"""Random and hostile .idl files against the real rosidl tool chain, and every difference from it made on purpose."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.example_counts import examples
from support.rosidl_deviations import DEVIATIONS, Deviation, compare_or_explain, explained, in_modules
from support.rosidl_oracle import OTHERS, Rosidl, accepted, different, ours

_EXAMPLES = [(row, text) for row in DEVIATIONS for text in row.examples]


@pytest.mark.parametrize(("row", "text"), _EXAMPLES, ids=[f"{row.name}: {text}" for row, text in _EXAMPLES])
def test_deliberate_differences_from_rosidl_still_exist(rosidl: Rosidl, row: Deviation, text: str) -> None:
    definition = (f"a_msgs/{row.kind}/Sample", text, row.kind)
    if row.format == "idl":
        definition = (definition[0], in_modules(text, row.kind), "idl")
    mine = ours([definition], OTHERS)
    for release, theirs in rosidl.compile([definition]).items():
        accept = ("types" in mine, accepted(theirs))
        assert row.who == {(True, False): "we", (False, True): "they"}.get(accept, "both"), (release, mine, theirs)
        assert different(mine, theirs)
        assert explained(*definition[1:], mine, theirs) or not different(mine, theirs, loose=True)


# --- at random --------------------------------------------------------------------------------------------------------

# A file is a list of tokens, so that mutations change whole tokens instead of letters.
Tokens = list[str]

_VALUES = {
    "boolean": st.sampled_from(["TRUE", "FALSE"]),
    "octet": st.integers(0, 255).map(str),
    "int8": st.integers(-128, 127).map(str),
    "short": st.integers(-(2**15), 2**15 - 1).map(str),
    "unsigned long": st.integers(0, 2**32 - 1).map(str),
    "long long": st.integers(-(2**63), 2**63 - 1).map(str),
    "uint64": st.integers(0, 2**64 - 1).map(str),
    "float": st.floats(width=32, allow_nan=False, allow_infinity=False).map(repr),
    "double": st.floats(allow_nan=False, allow_infinity=False).map(repr),
    "string": st.text(st.sampled_from("ab 0.é€\t{}%"), max_size=5).map(lambda text: f'"{text}"'),
    "wstring": st.sampled_from(['"a"', 'L"a"', 'L"\\u00fc"', '"x\\"y"', '"a\\tb" "c"', '"\\x41\\101"']),
    "char": st.none(),
    "wchar": st.none(),
}
_PAIRS = {
    "sequence<double>": "(1.5, 2.0)",
    "sequence<float, 3>": "(1.5, -2.0)",
    "short[2]": "(1, -2)",
    "sequence<string>": "('a', '')",
    "boolean[2]": "(True, False)",
}
_SUFFIXES = {"msg": ("",), "srv": ("_Request", "_Response"), "action": ("_Goal", "_Result", "_Feedback")}
_NAMES = ("x", "y", "a_b", "in_", "self", "A", "shorter", "TRUEx", "module1", "strings", "a__b", "z_", "long_1")
_ANNOTATIONS = (
    "@key",
    '@unit(value="m")',
    "@range(min=-1, max=5.5)",
    "@a::b",
    '@verbatim(language="comment", text="t" "u")',
)


def words(text: str) -> Tokens:
    """Return the tokens of a text without comments."""
    return re.findall(r'L?"(?:[^"\\]|\\.)*"|[A-Za-z_][A-Za-z0-9_]*|-?[0-9][0-9.eE+-]*|::|\S', text)


@st.composite
def _types(draw: st.DrawFn, typedefs: list[str], arrays: bool = True) -> str:
    base = draw(st.sampled_from([*_VALUES, "string<3>", "wstring<12>", "b_msgs::msg::Other", *typedefs]))
    if not arrays or draw(st.integers(0, 2)) or base in typedefs:
        return base
    return draw(st.sampled_from([f"sequence<{base}>", f"sequence<{base}, 3>", f"{base}[2]"]))


@st.composite
def _structs(draw: st.DrawFn, name: str, number: int, typedefs: list[str], most: int) -> Tokens:
    tokens: Tokens = []
    if draw(st.booleans()):
        tokens += words(f"module {name}_Constants {{")
        for constant in draw(
            st.lists(st.sampled_from(["LIMIT", "NAME", "B1"]), min_size=1, max_size=most, unique=True)
        ):
            kind = draw(st.sampled_from(sorted(_VALUES.keys() - {"char", "wchar"})))
            # One name a section: "same constant in two sections" is a deviation.
            tokens += [*words(f"const {kind} {constant}_{number} ="), *words(draw(_VALUES[kind]) or ""), ";"]
        tokens += words("};")
    tokens += words(f"struct {name} {{")
    for member in draw(st.lists(st.sampled_from(_NAMES), min_size=1, max_size=most, unique=True)):
        kind = draw(_types(typedefs))
        tokens += words(" ".join(draw(st.lists(st.sampled_from(_ANNOTATIONS), max_size=1))))
        if kind in _VALUES and draw(st.booleans()) and (value := draw(_VALUES[kind])):
            tokens += [*words("@default(value="), *words(value), ")"]
        elif kind in _PAIRS and draw(st.booleans()):
            tokens += words(f'@default(value="{_PAIRS[kind]}")')
        tokens += _declared(kind, member)
    return [*tokens, *words("};")]


def _declared(kind: str, name: str) -> Tokens:
    base, bracket, size = kind.partition("[")
    return words(f"{base} {name}{bracket}{size};")


@st.composite
def files(draw: st.DrawFn, most: int = 4) -> tuple[str, Tokens]:
    """Draw a name and the tokens of a valid file, with up to `most` members in each struct."""
    kind = draw(st.sampled_from(["msg", "msg", "msg", "srv", "action"]))
    tokens = words(f"module a_msgs {{ module {kind} {{")
    typedefs: list[str] = []
    for _ in range(draw(st.integers(0, most - 1))):
        target = draw(_types([]).filter(lambda text: "wstring<" not in text))
        typedefs.append(f"t{len(typedefs)}")
        tokens += ["typedef", *_declared(target, typedefs[-1])]
    for number, suffix in enumerate(_SUFFIXES[kind]):
        tokens += words(draw(st.sampled_from(["", "", f"struct Sample{suffix};", "struct Other; struct Other;"])))
        tokens += draw(_structs(f"Sample{suffix}", number, typedefs, most))
    return f"a_msgs/{kind}/Sample", [*tokens, *words("}; };")]


_GAPS = st.sampled_from([" "] * 12 + ["\n", "  ", "\t", " /* c; */ ", " // c }\n", "\r\n"])


@st.composite
def spelled(draw: st.DrawFn, tokens: Tokens) -> str:
    pieces = [token + draw(_GAPS) for token in tokens]
    include = draw(st.sampled_from(["", "", '#include "b_msgs/msg/Other.idl"\n', "#include <x.idl>\n// c\n"]))
    return include + "".join(pieces)


_ODD = (
    *("module", "struct", "const", "typedef", "enum", "union", "long", "unsigned", "double", "string", "sequence", "x"),
    *("{", "}", ";", ",", "<", ">", "[", "]", "(", ")", "@", "::", "=", "-", "+", "~", "|", ":", "#", "'", "0"),
    *("3", "-1"),
    *("1.5", "1d", "300", "0x1f", "TRUE", "true", '"text"', 'L"w"', '"\\q"', "A", "Other", "N", "default"),
    *("value", "\x00"),
)


@st.composite
def broken(draw: st.DrawFn) -> tuple[str, str]:
    """Draw a name and the text of a file in which up to three tokens are wrong."""
    name, tokens = draw(files(most=2))
    for _ in range(draw(st.sampled_from([1, 1, 1, 2, 3]))):
        at = draw(st.integers(0, max(0, len(tokens) - 1)))
        match draw(st.sampled_from(["drop", "twice", "swap", "odd", "odd", "other", "other", "insert"])):
            case "drop":
                del tokens[at]
            case "twice":
                tokens[at:at] = tokens[at : at + draw(st.integers(1, 4))]
            case "swap":
                tokens[at : at + 2] = reversed(tokens[at : at + 2])
            case "other":
                alike = [
                    token for token in {*tokens, *_ODD} if token[:1].isalpha() == tokens[at : at + 1][0][:1].isalpha()
                ]
                tokens[at] = draw(st.sampled_from(sorted(alike)))
            case "odd":
                tokens[at : at + 1] = [draw(st.sampled_from(_ODD))]
            case _:
                tokens.insert(at, draw(st.sampled_from(_ODD)))
    return name, draw(spelled(tokens))


@settings(max_examples=examples(150))
@given(st.data())
def test_rosidl_agrees_about_random_files(rosidl: Rosidl, data: st.DataObject) -> None:
    name, tokens = data.draw(files())
    text = data.draw(spelled(tokens))
    definition = (name, text, "idl")
    mine = ours([definition], OTHERS)
    assert "types" in mine, mine
    for release, theirs in rosidl.compile([definition]).items():
        difference = different(mine, theirs, loose=True)
        assert not difference, f"{release}: {difference}, in {text!r}"


@settings(max_examples=examples(400))
@given(broken())
def test_rosidl_agrees_about_hostile_files(rosidl: Rosidl, file: tuple[str, str]) -> None:
    compare_or_explain(rosidl, (*file, "idl"))
