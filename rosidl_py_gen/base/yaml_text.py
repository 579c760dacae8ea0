"""YAML loader of the whole package: PyYAML's safe loader in C, with limits of cost and without surprising rules of YAML
1.1.

A text may come from an untrusted file or peer. These rules apply to every text:

- A text has at most `_MAX_BYTES` bytes, and at most `MAX_VALUES` values after aliases are replaced. It has at most 100
  levels, because libyaml and PyYAML recurse in C.
- A text has at most `_MAX_DIRECTIVES` ``%TAG`` lines, because libyaml compares them with each other: 80 000 lines take
  14 s.
- Numbers have at most 400 characters. They are written as in JSON and YAML 1.2, such as ``1e-3``; the integers of YAML
  1.1 (``1:30``, ``010``, ``1_000``) are texts. PyYAML reads ``1:30:…`` in quadratic time: 200 000 parts in 30 s.
- A key is the text that is written there. PyYAML would convert the text, and a dict of integers chosen by an attacker
  takes quadratic time.

`tests/core/base/test_yaml_text.py` has the cases.
"""

from __future__ import annotations

import contextlib
import math
import re
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.errors import RosidlError

try:
    import yaml
except ModuleNotFoundError as missing:
    raise Extra.missing_error(missing) or missing from None

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    _PyYamlLoader = yaml.SafeLoader
else:
    _PyYamlLoader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_MAX_BYTES = 1 << 26
"""Default maximum bytes of a YAML text."""
MAX_VALUES = 1_000_000
"""Maximum number of keys, values, lists and mappings in a YAML text: PyYAML needs about 600 bytes for each."""
MAX_LEVELS = 100
"""Maximum depth of lists and mappings in a YAML text: each level takes about 500 bytes of a thread's stack."""
_MAX_DIRECTIVES = 20
_TAG = "tag:yaml.org,2002:"
_STRING = f"{_TAG}str"
_INT, _FLOAT = f"{_TAG}int", f"{_TAG}float"
_MERGE = f"{_TAG}merge"
_DIRECTIVE = re.compile("(?:^|[\r\n\x85\u2028\u2029])%TAG")
_MAX_NUMBER = 400
_NUMBER = re.compile(
    r"(?!.{401})[-+]?(?:0x[0-9a-fA-F]+|0b[01]+|(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
    r"|\.(?:inf|Inf|INF))\Z|\.(?:nan|NaN|NAN)\Z"
)
_BOOL = re.compile(r"(?:yes|no|true|false|on|off)\Z", re.IGNORECASE)
_NULL = re.compile(r"(?:~|null|Null|NULL|)\Z")


class YamlError(RosidlError, ValueError):
    """Error of a text that is not YAML, or exceeds a limit; `place` is line and column as ``3:5``, empty if unknown."""

    def __init__(self, problem: str, mark: Any = None) -> None:
        self.problem = problem[:300]
        self.place = f"{mark.line + 1}:{mark.column + 1}" if mark else ""
        super().__init__(f"{self.place}: {self.problem}" if self.place else self.problem)

    def at(self, name: str) -> str:
        """Return the error's text for a named file, in which line and column follow after the name of the file."""
        return f"{name}:{self}" if self.place else f"{name}: {self}"


class _Loader(_PyYamlLoader):
    """PyYAML loader that `YamlText.load` uses."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012 (PyYAML's own name)
    number: Callable[[str], Any]

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Merge ``<<`` entries into a mapping, then convert every key to text."""
        if sum(key.tag == _MERGE for key, _ in node.value) > 1:  # PyYAML takes quadratic time for many
            raise yaml.MarkedYAMLError(problem="expected one <<, got more", problem_mark=node.start_mark)
        super().flatten_mapping(node)
        node.value = [(_as_text(key), value) for key, value in node.value]

    def construct_number(self, node: yaml.ScalarNode) -> Any:
        """Return the value of a YAML number, including a number with a tag such as ``!!int``."""
        text = self.construct_scalar(node)
        if len(text) > _MAX_NUMBER:
            raise yaml.MarkedYAMLError(problem=f"expected a number, got {text[:50]!r}", problem_mark=node.start_mark)
        return self.number(text)


class _RclpyLoader(_Loader):
    """PyYAML loader that `YamlText.load` uses for rclpy programs: scalars are converted as by ``yaml.safe_load``."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012

    def construct_number(self, node: yaml.ScalarNode) -> Any:
        if len(node.value) > _MAX_NUMBER:
            super().construct_number(node)
        return self.construct_yaml_int(node) if node.tag == _INT else self.construct_yaml_float(node)


class _TreeLoader(_PyYamlLoader):
    """PyYAML loader that `YamlText.compose` uses: all untagged scalars get the tag `YamlText.UNTAGGED`."""

    def resolve(self, kind: Any, value: Any, implicit: Any) -> str:
        return YamlText.UNTAGGED if kind is yaml.ScalarNode else str(super().resolve(kind, value, implicit))  # type: ignore[no-untyped-call]


class _AnchorLoader(_TreeLoader):
    """PyYAML loader that `YamlText.compose` uses to ignore anchors instead of refusing them."""


def _add_resolvers() -> None:
    merge = re.compile(r"<<\Z")
    for tag, pattern, first in (
        (_INT, _NUMBER, "-+.0123456789"),
        (f"{_TAG}bool", _BOOL, "ynYNtTfFoO"),
        (f"{_TAG}null", _NULL, ["~", "n", "N", ""]),
        (_MERGE, merge, "<"),
    ):
        _Loader.add_implicit_resolver(tag, pattern, list(first))
    for start, rows in yaml.SafeLoader.yaml_implicit_resolvers.items():
        for tag, pattern in rows:
            if tag in (_INT, _FLOAT):
                pattern = re.compile(f"(?!.{{{_MAX_NUMBER + 1}}}){pattern.pattern}", re.VERBOSE)
            if tag not in (f"{_TAG}timestamp", f"{_TAG}value"):
                _RclpyLoader.add_implicit_resolver(tag, pattern, [start])
    for loader in (_Loader, _RclpyLoader):
        for tag in (_INT, _FLOAT):
            loader.add_constructor(tag, loader.construct_number)


_add_resolvers()


def _as_number(text: str) -> int | float:
    try:
        return int(text, 0)
    except ValueError:
        return float(text.replace(".inf", "inf").replace(".nan", "nan") if text[-1:] in "fnFN" else text)


class YamlText:
    """YAML text that is read with limits of its cost.

    Args:
        text: bytes are decoded as UTF-8.
        max_bytes: size limit; each character of a str counts as one byte.
        max_levels: maximum depth of lists and mappings.
    """

    UNTAGGED = "!untagged"
    """Tag that `compose` gives to scalars without a tag; their `style` tells plain, quoted and block scalars apart."""

    def __init__(self, text: str | bytes, *, max_bytes: int = _MAX_BYTES, max_levels: int = MAX_LEVELS) -> None:
        self._text = text
        self._max_bytes = max_bytes
        self._max_levels = max_levels

    def load(self, *, number: Callable[[str], Any] = _as_number, like_rclpy: bool = False) -> Any:
        """Return the value of the text; None for an empty text.

        Args:
            number: called with the text of each number, returns its value; by default an int or a float.
            like_rclpy: convert scalars as ``yaml.safe_load`` does: ``1:30`` is 90, ``1e5`` is a text; `number` is
                ignored.

        Raises:
            YamlError: the text is not YAML, or exceeds a limit.
        """

        def read(text: str) -> Any:
            loader = (_RclpyLoader if like_rclpy else _Loader)(text)
            loader.number = number
            return loader.get_single_data()

        return self._checked(_Loader, read)

    def compose(self, *, anchors: bool = False) -> yaml.Node | None:
        """Return the node tree of the text, in which scalars are not converted; None for an empty text.

        Scalars without a tag have the tag `UNTAGGED`, also if they look like numbers. With `anchors`, anchors are
        ignored.

        Raises:
            YamlError: the text is not YAML, exceeds a limit, or has aliases or, unless `anchors` is set, anchors.
        """
        loader = _AnchorLoader if anchors else _TreeLoader
        node: yaml.Node | None = self._checked(loader, lambda text: loader(text).get_single_node())
        return node

    def events(self) -> Iterator[yaml.Event]:
        """Yield the events of all documents in the text. Anchors are ignored; the tag of an untagged scalar is None.

        Raises:
            YamlError: the text is not YAML, exceeds a limit, or has aliases. Events before the place were yielded.
        """
        with _yaml_errors():
            for event in _checked_events(self._decoded(), _PyYamlLoader, self._max_levels):
                if isinstance(event, yaml.AliasEvent):
                    raise YamlError("anchors and aliases are not supported", event.start_mark)
                yield event

    def _checked(self, loader: Any, read: Callable[[str], Any]) -> Any:
        with _yaml_errors():
            text = self._decoded()
            for event in _checked_events(text, loader, self._max_levels):
                is_refused = loader is _TreeLoader or (loader is _AnchorLoader and isinstance(event, yaml.AliasEvent))
                if is_refused and getattr(event, "anchor", None) is not None:
                    raise YamlError("anchors and aliases are not supported", event.start_mark)
            return read(text)

    def _decoded(self) -> str:
        """Return the text, decoded from bytes; raises `YamlError` if its size or its directives exceed a limit."""
        text = self._text
        if len(text) > self._max_bytes:
            raise YamlError(f"{len(text)} bytes; expected at most {self._max_bytes}")
        text = text.decode("utf-8-sig") if isinstance(text, bytes) else text
        if sum(1 for _ in _DIRECTIVE.finditer(text)) > _MAX_DIRECTIVES:
            raise YamlError(f"more than {_MAX_DIRECTIVES} %TAG directives")
        return text


@contextlib.contextmanager
def _yaml_errors() -> Iterator[None]:
    """Convert errors that PyYAML raises in the block to `YamlError`."""
    try:
        yield
    except yaml.MarkedYAMLError as error:
        raise YamlError(
            error.problem or error.context or "not YAML", error.problem_mark or error.context_mark
        ) from None
    except UnicodeError:
        raise YamlError("expected UTF-8") from None
    except RosidlError:
        raise
    except yaml.YAMLError as error:
        raise YamlError(str(error).partition("\n")[0]) from None
    except Exception as error:  # a wrong value of `!!int`, `!!bool` or `!!timestamp` raises one of a dozen classes
        raise YamlError(f"a value does not match its tag: {type(error).__name__} {error}") from None


def _checked_events(text: str, loader: Any, max_levels: int) -> Iterator[yaml.Event]:
    """Yield the parsing events of a YAML text; raises `YamlError` if nesting levels or values exceed a limit.

    A value that aliases repeat counts each time.
    """
    open_counts = [0.0]
    open_anchors: list[str | None] = []
    anchors: dict[str | None, float] = {}
    for index, event in enumerate(yaml.parse(text, Loader=loader)):
        anchor = getattr(event, "anchor", None)
        if isinstance(event, yaml.CollectionStartEvent):
            open_counts.append(0)
            open_anchors.append(anchor)
            anchors[anchor] = math.inf  # until its end, as it would contain itself
            if len(open_anchors) > max_levels:
                raise YamlError(f"more than {max_levels} levels", event.start_mark)
        elif isinstance(event, yaml.CollectionEndEvent):
            count = anchors[open_anchors.pop()] = open_counts.pop() + 1
            open_counts[-1] += count
        elif isinstance(event, yaml.AliasEvent):
            open_counts[-1] += anchors.get(anchor, 1)
        elif isinstance(event, yaml.ScalarEvent):
            open_counts[-1] += 1
            anchors[anchor] = 1
        if open_counts[-1] > MAX_VALUES or index > 2 * MAX_VALUES:
            raise YamlError(f"more than {MAX_VALUES} values, aliases written out", event.start_mark)
        yield event


def _as_text(key: yaml.Node) -> yaml.Node:
    if not isinstance(key, yaml.ScalarNode) or key.tag == _STRING:
        return key
    return yaml.ScalarNode(_STRING, key.value, key.start_mark, key.end_mark)
