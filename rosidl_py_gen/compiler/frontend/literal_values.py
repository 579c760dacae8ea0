"""Parser of default values and constants in definition files: from their text to Python values.

rosidl converts a string default into IDL text and reads it back, so an escape has the meaning that survives both
stages. `_through_idl` reproduces the two stages with their quirks, so that the same texts are accepted. Rules:
docs/internals/protocol.md 1.4.
"""

from __future__ import annotations

import codecs
import re
from ast import literal_eval
from typing import TYPE_CHECKING

from rosidl_py_gen.base.fieldtype import PRIMITIVES, Arity, FieldType

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.frontend.model import Default, Scalar

_MAX_DIGITS = 400
"""Maximum digits of an integer in a definition: more digits than any valid value has, fewer than Python refuses to
convert."""
_MAX_ELEMENTS_AT_ONCE = 4096
"""Maximum elements of a list in a definition that Python parses at a time; the syntax tree takes 250 bytes for each
element."""
_IDL_STRING = re.compile(r'"(.*?)(?<!\\)(?:\\\\)*?"')
_IDL_ESCAPE = re.compile(r"\\[ntvbrfa\\?'\"]|\\[0-7]{1,3}|\\x[0-9a-fA-F]{1,2}")
_PYTHON_ESCAPE = re.compile(r"\\([4-7][0-7]{2}|.)", re.DOTALL)
_PYTHON_ESCAPES = "\n\\'\"abfnrtv01234567xuUN"
_IDL_WIDE_ESCAPE = re.compile(_IDL_ESCAPE.pattern + r"|\\u[0-9a-fA-F]{1,4}")


class LiteralProblem(ValueError):
    """Error for a text that is not a value of the expected type.

    `is_at_end` is True if a list ends where an element is expected.
    """

    def __init__(self, text: str, is_at_end: bool = False) -> None:
        super().__init__(text)
        self.is_at_end = is_at_end


def parse_default(kind: FieldType, text: str) -> Default:
    """Return the default value of a field from its text; raises `LiteralProblem` for an invalid value."""
    if kind.is_message:
        raise LiteralProblem(f'a field of type "{kind}" cannot have a default')
    if kind.arity is Arity.SCALAR:
        return parse_scalar(kind, text)
    if not (text.startswith("[") and text.endswith("]") and len(text) >= 2):
        raise LiteralProblem(f"expected values in brackets [..] for {kind}, found {_cut(text)}")
    inside = text[1:-1]
    if kind.is_string:
        values: tuple[Scalar, ...] = _string_elements(kind, inside)
    else:
        pieces = inside.split(",") if inside else []
        values = tuple(parse_scalar(kind.element, piece.strip()) for piece in pieces)
    if kind.arity is Arity.ARRAY and len(values) != kind.capacity:
        raise LiteralProblem(f"expected exactly {kind.capacity} values for {kind}, found {len(values)}")
    if kind.arity is Arity.BOUNDED and len(values) > kind.capacity:
        raise LiteralProblem(f"expected at most {kind.capacity} values for {kind}, found {len(values)}")
    return values


def parse_scalar(kind: FieldType, text: str) -> Scalar:
    """Return the value of a constant, scalar field or array element from its text; raises `LiteralProblem`."""
    value = file_scalar(kind, text)
    # The bound counts characters of the file, with escapes.
    return _through_idl(_check_bound(kind, value)) if isinstance(value, str) else value


def file_scalar(kind: FieldType, text: str) -> Scalar:
    """Return the value of a constant or default as the file states it, before rosidl converts the text to IDL.

    Bounds of strings are not checked. Raises `LiteralProblem` if the text is not a value of the type.
    """
    if kind.is_string:
        return _unquote(text)
    match PRIMITIVES[kind.base].python:
        case "bool":
            return _boolean(text)
        case "float":
            return _floating(text)
        case _:
            return _integer(kind.base, text)


def _cut(text: str) -> str:
    return repr(text if len(text) <= 60 else text[:57] + "...")


def _boolean(text: str) -> bool:
    word = text.lower()
    if word in ("true", "1"):
        return True
    if word in ("false", "0"):
        return False
    raise LiteralProblem(f"expected true, false, 1 or 0, found {_cut(text)}")


def _floating(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise LiteralProblem(f"expected a floating point number, found {_cut(text)}") from None


def _integer(base: str, text: str) -> int:
    low, high = PRIMITIVES[base].integer_range
    value: int | None = None
    if len(text) <= _MAX_DIGITS:
        for number_base in (10, 0):
            try:
                value = int(text, number_base)
                break
            except ValueError:
                continue
    if value is None or not low <= value <= high:
        raise LiteralProblem(f"expected an integer in {low}..{high} for {base}, found {_cut(text)}")
    return value


def _check_bound(kind: FieldType, text: str) -> str:
    if kind.string_bound and len(text) > kind.string_bound:
        raise LiteralProblem(f"expected at most {kind.string_bound} characters, found {len(text)}")
    return text


def _unquote(text: str) -> str:
    for quote in ('"', "'"):
        if text.startswith(quote) and text.endswith(quote):
            inside = text[1:-1]
            if re.search(rf"(?<!\\){quote}", inside):
                raise LiteralProblem(f"expected inner quotes to be escaped, found {_cut(text)}")
            return inside.replace("\\" + quote, quote)
    return text


def _string_elements(kind: FieldType, text: str) -> tuple[str, ...]:
    # rosidl reads each element like a scalar, so it also removes blanks and quotes inside the quotes.
    values = [_check_bound(kind, _unquote(value.strip())) for value in split_strings(text)]
    # rosidl passes the Python repr of the whole tuple through the IDL stage; slices take less memory.
    results: list[str] = []
    for start in range(0, len(values), _MAX_ELEMENTS_AT_ONCE):
        rendered = repr(tuple(values[start : start + _MAX_ELEMENTS_AT_ONCE])).replace("\\", r"\\").replace('"', r"\"")
        result = python_value(decode_idl_string(rendered))
        if not isinstance(result, tuple) or not all(isinstance(item, str) for item in result):
            raise LiteralProblem(f"expected a list of strings, found {_cut(text)}")
        results += result
    return tuple(results)


def split_strings(text: str) -> list[str]:
    """Return the elements of a list of strings, given without brackets; raises `LiteralProblem` for an invalid list."""
    values: list[str] = []
    position = 0
    while position < len(text):
        while position < len(text) and text[position] == " ":
            position += 1
        if position == len(text) or text[position] == ",":
            reason = f"expected a string at character {position + 1} of the list, found nothing"
            raise LiteralProblem(reason, is_at_end=position == len(text))
        if text[position] in "\"'":
            value, position = _quoted(text, position)
        else:
            end = text.find(",", position)
            end = len(text) if end < 0 else end
            value, position = text[position:end].strip(), end
        values.append(value)
        while position < len(text) and text[position] == " ":
            position += 1
        if position < len(text) and text[position] == ",":
            position += 1
    return values


def _quoted(text: str, start: int) -> tuple[str, int]:
    """Return the quoted string at index `start` of a text and the index after it.

    Raises `LiteralProblem` if the closing quote is missing. Quirks of rosidl are reproduced: rosidl misses a quote
    directly after an escaped quote, and from the second escaped quote on measures the length from the last one.
    """
    quote = text[start]
    position, skipped = start, 0
    while True:
        end = text.find(quote, position + 1)
        if end < 0:
            raise LiteralProblem(f"expected a closing {quote}, found the end of the list")
        length = end - position - 1
        if text[end - 1] != "\\":
            end = start + skipped + length + 1
            return text[start + 1 : end].replace("\\" + quote, quote), end + 1
        position, skipped = end + 1, length + 2


def _through_idl(value: str) -> str:
    try:
        escaped = _PYTHON_ESCAPE.sub(_known_escape, value).encode()
        text = escaped.decode("unicode_escape").replace('"', r"\"").encode("latin-1").decode()
    except UnicodeError:
        raise LiteralProblem(f"expected text with valid escapes, found {_cut(value)}") from None
    literal = f'"{text}"'
    found = _IDL_STRING.match(literal)
    if found is None or found.end() != len(literal) or "\r" in text:
        raise LiteralProblem(f"expected text whose escapes leave no line break or open quote, found {_cut(value)}")
    return decode_idl_string(text)


def _known_escape(found: re.Match[str]) -> str:
    """Return an escape sequence that the codec `unicode_escape` supports unchanged, or with its backslash doubled if it
    does not.

    Raises `LiteralProblem` for an octal escape above 0o377.
    """
    if len(found[1]) == 3:
        raise LiteralProblem(f"expected an octal escape up to \\377, found {found[0]}")
    return found[0] if found[1] in _PYTHON_ESCAPES else "\\" + found[0]


def python_value(text: str) -> object:
    """Return the value of a Python literal; None if the text is not a Python literal."""
    try:
        return literal_eval(_PYTHON_ESCAPE.sub(_quiet_escape, text))
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return None


def _quiet_escape(found: re.Match[str]) -> str:
    """Return an escape sequence of a Python string literal in an equivalent form for which Python emits no warning."""
    return f"\\u{int(found[1], 8):04x}" if len(found[1]) == 3 else _known_escape(found)


def decode_idl_string(text: str, wide: bool = False) -> str:
    """Return the value of an IDL string literal without its quotes (IDL 4.2 table 7-9, as rosidl reads it).

    Raises `LiteralProblem` for an incomplete escape.
    """
    try:
        value = (_IDL_WIDE_ESCAPE if wide else _IDL_ESCAPE).sub(_idl_character, text)
    except UnicodeError:
        raise LiteralProblem(f"expected a complete escape, found {_cut(text)}") from None
    return re.sub(r'\\(["\\])', r"\1", value)


def _idl_character(found: re.Match[str]) -> str:
    if found[0] == r"\?":
        return found[0]
    if found[0][1].isdigit():
        return chr(int(found[0][1:], 8))
    return codecs.decode(found[0], "unicode-escape")
