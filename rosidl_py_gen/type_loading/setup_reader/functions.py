"""Functions and methods that a setup.py may call, implemented for a reader that does not run the file.

The functions compute with known values only, spend work of the package's budget before they create a value, and read
only files of the package. A call that is not understood raises `UncertainError`.
"""

from __future__ import annotations

import os
import posixpath
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from pathlib import PurePosixPath
from string import Formatter
from typing import Any, NamedTuple

from rosidl_py_gen.compiler.frontend import PackageBudget, UnreadableError
from rosidl_py_gen.type_loading.setup_reader.package_folder import PATTERN_WORK, PackageFolder
from rosidl_py_gen.type_loading.setup_reader.values import (
    Bound,
    DictValue,
    FileValue,
    Gap,
    IteratorValue,
    Known,
    ListValue,
    UncertainError,
    ViewValue,
    plain,
    wrapped,
)

Words = dict[str, object]


class InterpreterMethods(NamedTuple):
    """Methods of the setup.py interpreter that its implementations of functions call.

    Attributes:
        iterate: yields the elements of a value, with a `Gap` for unknown ones.
        each: yields the elements of an iterator, each with the reason why it may be missing.
        call: returns the result of a call.
        doubting: context manager for code that may not be evaluated, for a reason.
        touch: marks a value, and all values that can be reached from it, as uncertain.
    """

    iterate: Callable[[object], Iterator[object]]
    each: Callable[[Iterator[object]], Iterator[tuple[object, str]]]
    call: Callable[[object, list[object], Words], object]
    doubting: Callable[[str], AbstractContextManager[None]]
    touch: Callable[[object, str], None]


SETUP_FUNCTIONS = ("setuptools.setup", "distutils.core.setup")
MODULES = (
    "os",
    "os.path",
    "sys",
    "glob",
    "pathlib",
    "setuptools",
    "distutils",
    "distutils.core",
    "itertools",
    "fnmatch",
)
"""Modules some of whose functions the reader of setup.py understands."""
HARMLESS_MODULES = {
    *("abc", "argparse", "ast", "codecs", "collections", "configparser", "contextlib", "copy", "csv", "dataclasses"),
    *("datetime", "enum", "functools", "hashlib", "io", "json", "locale", "logging", "math", "operator", "platform"),
    *("pprint", "re", "string", "sysconfig", "textwrap", "time", "tomllib", "traceback", "types", "typing", "uuid"),
    *("warnings", "xml", "__future__", *MODULES),
}
"""Modules whose functions change no files, even if the reader does not understand them."""
HARMLESS_BUILTINS = {
    *("iter", "map", "max", "min", "next", "object", "set", "frozenset", "slice", "staticmethod", "classmethod"),
    *("property", "super", "getattr", "Exception", "RuntimeError", "ValueError", "OSError", "IOError", "ImportError"),
    *("FileNotFoundError", "KeyError", "filter"),
}
"""Builtin functions and types of Python that change no files, but whose results the reader does not compute."""
PURE_BUILTINS = {
    *("abs", "bytes", "callable", "chr", "float", "format", "hasattr", "hash", "id", "int", "isinstance", "issubclass"),
    *("ord", "pow", "repr", "round", "type", "ascii", "bin", "hex", "divmod", "complex"),
}
"""Builtin functions that change nothing, and whose results do not contain their arguments."""
SCOPE_FUNCTIONS = {"exec", "eval", "globals", "locals", "vars", "setattr", "delattr", "compile", "__import__"}
"""Builtin functions that may change every variable."""
_CONSTANTS: dict[str, object] = {
    "os.sep": os.sep,
    "os.path.sep": os.sep,
    "os.name": os.name,
    "os.curdir": ".",
    "os.pardir": "..",
    "os.altsep": os.altsep,
    "os.linesep": os.linesep,
    "os.extsep": ".",
    "sys.platform": sys.platform,
    "sys.maxsize": sys.maxsize,
    "sys.byteorder": sys.byteorder,
}
_PERCENT = re.compile(r"%([sd%])")
MAX_INT = 10**12
"""Maximum absolute value of numbers that the reader of setup.py computes, so that numbers and their texts are short."""
_TEXT_METHODS = {
    *("strip", "lstrip", "rstrip", "startswith", "endswith", "lower", "upper", "title", "capitalize", "removeprefix"),
    *("removesuffix", "split", "rsplit", "splitlines", "partition", "rpartition", "find", "rfind", "index", "isdigit"),
    *("isidentifier", "isalpha", "isalnum", "count"),
}
_PATH_PROPERTIES = ("name", "stem", "suffix", "parent")


def version_info() -> ListValue:
    return ListValue([*sys.version_info], is_tuple=True)


class Functions:
    """Implementations of the functions and methods that the reader of a package's setup.py understands."""

    def __init__(self, folder: PackageFolder, budget: PackageBudget, reader: InterpreterMethods) -> None:
        self._folder, self._budget, self._reader = folder, budget, reader
        self._iterate = reader.iterate
        self._functions: dict[str, Callable[..., object]] = {
            **{f"os.path.{name}": self._path_function(name) for name in ("basename", "dirname", "split", "splitext")},
            **{f"os.path.{name}": self._path_function(name) for name in ("normpath", "isabs")},
            **{f"os.path.{name}": self._check(name) for name in ("exists", "isfile", "isdir", "islink", "lexists")},
            "os.path.join": self._join_path,
            "os.path.abspath": self._absolute,
            "os.path.realpath": self._real,
            "os.path.relpath": self._relative,
            "os.fspath": self._text,
            "os.getcwd": lambda: self._folder.real,
            "os.listdir": lambda path=".": self._list(self._folder.names(_text(path))),
            "os.walk": self._walk,
            "os.chdir": self._chdir,
            "glob.glob": self._glob,
            "glob.iglob": lambda *args, **words: IteratorValue(self._iterate(self._glob(*args, **words))),
            "fnmatch.fnmatch": self._fnmatch,
            "fnmatch.fnmatchcase": self._fnmatch,
            "fnmatch.filter": lambda names, pattern: self._list(
                name for name in self._iterate(names) if isinstance(name, Gap) or self._fnmatch(name, pattern)
            ),
            "itertools.chain": lambda *parts: IteratorValue(self._chain(iter(parts))),
            "itertools.chain.from_iterable": lambda parts: IteratorValue(self._chain(self._iterate(parts))),
            "setuptools.find_packages": lambda *args, **words: self._packages(*args, **words, is_namespace=False),
            "setuptools.find_namespace_packages": lambda *args, **words: self._packages(
                *args, **words, is_namespace=True
            ),
            "pathlib.Path": self._path,
            "pathlib.Path.cwd": lambda: self._path(self._folder.real),
            "collections.defaultdict": self._default_dict,
            "builtins.print": lambda *parts, **words: None,
            "builtins.str": self._text,
            "builtins.len": self._len,
            "builtins.bool": self._bool,
            "builtins.list": lambda part=None: self._list(() if part is None else self._iterate(part)),
            "builtins.tuple": lambda part=None: self._list(() if part is None else self._iterate(part), is_tuple=True),
            "builtins.dict": self._dict,
            "builtins.sorted": self._sorted,
            "builtins.reversed": self._reversed,
            "builtins.enumerate": self._enumerate,
            "builtins.zip": self._zip,
            "builtins.map": self._map,
            "builtins.filter": self._filter,
            "builtins.range": self._range,
            "builtins.sum": self._sum,
            "builtins.any": lambda part: self._any(part, True),
            "builtins.all": lambda part: not self._any(part, False),
            "builtins.open": self._open,
            "io.open": self._open,
            "codecs.open": self._open_by_codec,
        }
        self._functions["pathlib.PurePath"] = self._functions["pathlib.PosixPath"] = self._path

    def is_function(self, name: str) -> bool:
        return name in self._functions or name in SETUP_FUNCTIONS

    def attribute(self, base: object, name: str) -> object:
        """Return an attribute of a value; raises `UncertainError` for an attribute that is not understood."""
        if isinstance(base, Known):
            full = f"{base.name}.{name}".replace("posixpath.", "os.path.")
            if full in _CONSTANTS:
                return _CONSTANTS[full]
            if full == "sys.version_info":
                return version_info()
            if full in MODULES or self.is_function(full):
                return Known(full)
            raise UncertainError(full)
        if isinstance(base, PurePosixPath):
            if name in _PATH_PROPERTIES:
                return getattr(base, name)
            if name == "parts":
                return wrapped(base.parts)
        if isinstance(base, ListValue) and base.is_tuple and name in ("major", "minor", "micro"):
            return base.items[("major", "minor", "micro").index(name)]
        if isinstance(base, ListValue | DictValue | FileValue | PurePosixPath | str):
            return Bound(base, name)
        raise UncertainError(f"the attribute {name}")

    def call(self, name: str, args: list[object], words: Words) -> object:
        """Return the result of a function that is understood; raises `UncertainError` if it cannot be computed."""
        return self._checked(self._functions[name], args, words)

    def call_method(self, bound: Bound, args: list[object], words: Words, doubt: str) -> object:
        """Return the result of a method call; raises `UncertainError` if it cannot be computed.

        If `doubt` is not empty, the call may not happen, for this reason, so its changes are uncertain.
        """
        base, kind = bound.base, type(bound.base)
        if kind is str and bound.name in _TEXT_METHODS:
            self._budget.spend(4 * len(str(base)))
            return wrapped(getattr(base, bound.name)(*self._plain(args), **self._plain_words(words)))
        if "doubt" in words:  # the name of an argument of the methods below
            raise UncertainError("arguments that are not understood")
        prefix = {str: "_text_", ListValue: "_list_", DictValue: "_dict_", FileValue: "_file_"}.get(kind, "_path_")
        method = getattr(self, f"{prefix}{bound.name}", None)
        if method is None:
            raise UncertainError(f"the method {bound.name}")
        if kind in (ListValue, DictValue, FileValue) and bound.name not in ("copy", "items", "keys", "values", "get"):
            words = {**words, "doubt": doubt}
        return self._checked(method, [base, *args], words)

    def extend(self, target: ListValue, more: object, doubt: str) -> None:
        """Append the elements of a value to a list in setup.py.

        The list becomes uncertain for a reason `doubt`, or by an unknown element.
        """
        for element in [*self._iterate(more)] if more is target else self._iterate(more):
            if isinstance(element, Gap):
                target.why = target.why or element.why
            else:
                self._budget.step()
                target.items.append(element)
        target.why = target.why or doubt

    def joined(self, parts: Iterable[str], separator: str = "") -> str:
        """Return texts joined to one text, after spending the work for its characters."""
        texts = [*parts]
        self._budget.spend(sum(map(len, texts)) + len(separator) * len(texts))
        return separator.join(texts)

    def text_of(self, value: object) -> str:
        """Return `str` of a text, number or path; raises `UncertainError` for other values."""
        if isinstance(value, bool) or not isinstance(value, str | int | PurePosixPath):
            raise UncertainError(getattr(value, "why", "") or "the text of an object")
        return str(value)

    def operation(self, kind: str, left: object, right: object) -> object:
        """Return the result of a binary operator, given by the name of its syntax node, such as ``Add``.

        Raises `UncertainError` if it cannot be computed.
        """
        if isinstance(left, ListValue) and isinstance(right, ListValue) and kind == "Add":
            if left.is_tuple != right.is_tuple:
                raise UncertainError("a sum of a list and a tuple")
            self._budget.spend(8 * (len(left.items) + len(right.items)))
            return ListValue([*left.items, *right.items], left.is_tuple, left.why or right.why)
        if isinstance(left, ListValue) and isinstance(right, int) and kind == "Mult":
            self._budget.spend(8 * len(left.items) * max(0, right))
            return ListValue(left.items * right, left.is_tuple, left.why)
        if isinstance(left, str) and kind == "Mod":
            return self._percent(left, right)
        if isinstance(left, str) and isinstance(right, int) and kind == "Mult":
            self._budget.spend(len(left) * max(0, right))
            return left * right
        if isinstance(left, str) and isinstance(right, str) and kind == "Add":
            return self.joined((left, right))
        if kind == "Div" and (isinstance(left, PurePosixPath) or isinstance(right, PurePosixPath)):
            return self._path(left, right)
        if isinstance(left, DictValue) and isinstance(right, DictValue) and kind == "BitOr":
            self._budget.spend(8 * (len(left.items) + len(right.items)))
            return DictValue({**left.items, **right.items}, why=left.why or right.why)
        if isinstance(left, int) and isinstance(right, int) and max(abs(left), abs(right)) <= MAX_INT:
            operations: dict[str, Callable[[int, int], int]] = {
                "Add": int.__add__,
                "Sub": int.__sub__,
                "Mult": int.__mul__,
                "FloorDiv": int.__floordiv__,
                "Mod": int.__mod__,
            }
            if kind in operations and (right or kind in ("Add", "Sub", "Mult")):
                return operations[kind](left, right)
        raise UncertainError(next(filter(None, (getattr(one, "why", "") for one in (left, right))), "an operator"))

    def _checked(self, function: Callable[..., object], args: list[object], words: Words) -> object:
        try:
            return function(*args, **words)
        except PackageBudget.ExceededError:
            raise
        except UnreadableError as error:
            raise UncertainError(str(error)) from error
        except (TypeError, ValueError, LookupError, AttributeError) as error:  # other arguments than expected
            raise UncertainError("arguments that are not understood") from error

    def _plain(self, args: list[object]) -> list[Any]:
        return [plain(one, self._budget) for one in args]

    def _plain_words(self, words: Words) -> dict[str, Any]:
        return {name: plain(one, self._budget) for name, one in words.items()}

    def _list(self, elements: Iterable[object], *, is_tuple: bool = False) -> ListValue:
        found = ListValue(is_tuple=is_tuple)
        for element in elements:
            self._budget.step()
            if isinstance(element, Gap):
                found.why = found.why or element.why
            else:
                found.items.append(element)
        return found

    # --- paths --------------------------------------------------------------------------------------------------------

    def _path_function(self, name: str) -> Callable[[object], object]:
        def call(path: object) -> object:
            self._budget.spend(len(_text(path)))
            return wrapped(getattr(posixpath, name)(_text(path)))

        return call

    def _check(self, kind: str) -> Callable[[object], bool]:
        def call(path: object) -> bool:
            return bool(_known(self._folder.check(kind, _text(path)), self._folder.changes))

        return call

    def _join_path(self, first: object, *others: object) -> str:
        texts = [_text(first), *map(_text, others)]
        self._budget.spend(sum(map(len, texts)) + len(texts))
        return posixpath.join(*texts)

    def _absolute(self, path: object) -> str:
        return posixpath.normpath(self._join_path(self._folder.real, path))

    def _real(self, path: object) -> str:
        self._budget.access()
        if self._folder.place(_text(path)) is None or self._folder.changes:
            raise UncertainError(self._folder.changes or "a path outside of the package folder")
        return os.path.realpath(self._absolute(path))

    def _relative(self, path: object, start: object = ".") -> str:
        return posixpath.relpath(self._absolute(path), self._absolute(start))

    def _walk(self, top: object, topdown: object = True, onerror: object = None, followlinks: object = False) -> object:
        if topdown is not True or followlinks is not False or onerror is not None:
            raise UncertainError("options of os.walk")
        return IteratorValue(self._folder.walk(_text(top)))

    def _chdir(self, path: object) -> None:
        if _text(path) != "" and self._folder.place(_text(path)) != ".":
            raise UncertainError("a change of the working folder")

    def _glob(
        self, pathname: object, *, recursive: object = False, root_dir: object = None, include_hidden: object = False
    ) -> object:
        if root_dir is not None or not isinstance(recursive, bool) or not isinstance(include_hidden, bool):
            raise UncertainError("options of glob")
        return self._list(self._folder.glob(_text(pathname), recursive, include_hidden))

    def _fnmatch(self, name: object, pattern: object) -> bool:
        self._budget.spend(PATTERN_WORK * len(_text(pattern)) + len(_text(name)))
        return self._budget.matches(_text(name), _text(pattern))

    def _packages(
        self, where: object = ".", exclude: object = None, include: object = None, *, is_namespace: bool
    ) -> ListValue:
        excluded, included = [], ["*"]
        if exclude is not None:
            excluded = [str(one) for one in self._plain([self._list(self._iterate(exclude))])[0]]
        if include is not None:
            included = [str(one) for one in self._plain([self._list(self._iterate(include))])[0]]
        return self._list(self._folder.packages(_text(where), excluded, included, is_namespace))

    def _path(self, *parts: object) -> PurePosixPath:
        texts = [_text(part) for part in parts]
        self._budget.spend(2 * sum(map(len, texts)) + 8)
        return PurePosixPath(*texts)

    def _path_glob(self, base: PurePosixPath, pattern: object) -> object:
        return IteratorValue(self._folder.glob_paths(base, _text(pattern)))

    def _path_rglob(self, base: PurePosixPath, pattern: object) -> object:
        return IteratorValue(self._folder.glob_paths(base, f"**/{_text(pattern)}"))

    def _path_iterdir(self, base: PurePosixPath) -> object:
        names = self._folder.names(str(base))
        return IteratorValue(name if isinstance(name, Gap) else self._path(base, name) for name in names)

    def _path_exists(self, base: PurePosixPath) -> object:
        return _known(self._folder.check("exists", str(base)), self._folder.changes)

    def _path_is_file(self, base: PurePosixPath) -> object:
        return _known(self._folder.check("isfile", str(base)), self._folder.changes)

    def _path_is_dir(self, base: PurePosixPath) -> object:
        return _known(self._folder.check("isdir", str(base)), self._folder.changes)

    def _path_as_posix(self, base: PurePosixPath) -> object:
        return str(base)

    def _path_joinpath(self, base: PurePosixPath, *parts: object) -> object:
        return self._path(base, *parts)

    def _path_relative_to(self, base: PurePosixPath, other: object) -> object:
        return base.relative_to(_text(other))

    def _path_absolute(self, base: PurePosixPath) -> object:
        return self._path(self._folder.real, base)

    def _path_resolve(self, base: PurePosixPath) -> object:
        return self._path(self._real(base))

    def _path_with_suffix(self, base: PurePosixPath, suffix: object) -> object:
        return base.with_suffix(_text(suffix))

    def _path_read_text(self, base: PurePosixPath, encoding: object = None) -> object:
        return self._open(base, encoding=encoding).text

    def _path_open(
        self, base: PurePosixPath, mode: object = "r", buffering: object = -1, encoding: object = None
    ) -> object:
        return self._open(base, mode, encoding=encoding)

    # --- files --------------------------------------------------------------------------------------------------------

    def _open(
        self, path: object, mode: object = "r", buffering: object = -1, encoding: object = None, errors: object = None
    ) -> FileValue:
        if mode not in ("r", "rt") or str(encoding).lower() not in ("none", "utf-8", "utf8", "utf_8", "ascii"):
            raise UncertainError("a file that is not opened for reading")
        return FileValue(_known(self._folder.read(_text(path)), self._folder.changes))

    def _open_by_codec(self, path: object, mode: object = "r", encoding: object = None) -> FileValue:
        """Return the file that `codecs.open` opens in setup.py.

        Raises `UncertainError` if the builtin `open` would read other line ends.
        """
        file = self._open(path, mode, encoding=encoding)
        text = self._folder.read(_text(path), keeps_line_ends=True) or ""
        if encoding is not None and ("\r" in text or text.splitlines(keepends=True) != self.lines(text)):
            raise UncertainError("line ends of codecs.open")
        return file

    def _file_read(self, file: FileValue, *, doubt: str) -> str:
        if file.why:
            raise UncertainError(file.why)
        text = file.text[file.position :]
        file.position, file.why = len(file.text), doubt
        return text

    def _file_readlines(self, file: FileValue, *, doubt: str) -> object:
        return wrapped(self.lines(self._file_read(file, doubt=doubt)))

    def lines(self, text: str) -> list[str]:
        """Return the lines of a text, split only at line feeds as in a file.

        The method `str.splitlines` would split at more characters.
        """
        self._budget.spend(len(text) + 16 * text.count("\n"))
        *lines, last = text.split("\n")
        return [*(f"{line}\n" for line in lines), *([last] if last else [])]

    def _file_close(self, file: FileValue, *, doubt: str) -> None:
        file.why = file.why or "a file that is closed"

    # --- texts --------------------------------------------------------------------------------------------------------

    def _text(self, value: object = "") -> str:
        return self.text_of(value)

    def _text_join(self, separator: str, parts: object) -> str:
        return self.joined(self._plain([self._list(self._iterate(parts))])[0], separator)

    def _text_replace(self, text: str, old: object, new: object) -> str:
        old, new = str(*self._plain([old])), str(*self._plain([new]))
        self._budget.spend(len(text) + (text.count(old) + 1) * len(new))
        return text.replace(old, new)

    def _text_format(self, text: str, *args: object, **words: object) -> str:
        """Return `text.format(...)` for a setup.py.

        Raises `UncertainError` for fields with attributes or format specifications.
        """
        texts: list[str] = []
        count = 0
        self._budget.spend(4 * len(text))
        for literal, name, specification, conversion in Formatter().parse(text):
            texts.append(literal)
            if name is None:
                continue
            if specification or conversion:
                raise UncertainError("a format specification")
            if name == "":
                name, count = str(count), count + 1
            texts.append(self.text_of(args[int(name)] if name.isdecimal() else words[name]))
        return self.joined(texts)

    def _percent(self, text: str, values: object) -> str:
        parts = values.items if isinstance(values, ListValue) and values.is_tuple and not values.why else [values]
        pieces = _PERCENT.split(text)
        self._budget.spend(4 * len(text))
        waiting = iter(parts)
        texts: list[str] = []
        for index, piece in enumerate(pieces):
            if index % 2 == 0:
                if "%" in piece:
                    raise UncertainError("a format specification")
                texts.append(piece)
            elif piece == "%":
                texts.append("%")
            else:
                value = next(waiting, None)
                if piece == "d" and not isinstance(value, int):
                    raise UncertainError("a format specification")
                texts.append(self.text_of(value))
        if next(waiting, self) is not self:
            raise UncertainError("a format specification")
        return self.joined(texts)

    # --- lists and dicts ----------------------------------------------------------------------------------------------

    def _list_append(self, base: ListValue, value: object, *, doubt: str) -> None:
        base.items.append(value)
        base.why = base.why or doubt

    def _list_extend(self, base: ListValue, more: object, *, doubt: str) -> None:
        self.extend(base, more, doubt)

    def _list_insert(self, base: ListValue, index: object, value: object, *, doubt: str) -> None:
        self._budget.spend(len(base.items))
        base.items.insert(self._plain([index])[0], value)
        base.why = base.why or doubt

    def _list_reverse(self, base: ListValue, *, doubt: str) -> None:
        self._budget.spend(len(base.items))
        base.items.reverse()
        base.why = base.why or doubt

    def _list_sort(self, base: ListValue, *, doubt: str) -> None:
        base.items[:] = self._sorted(base).items
        base.why = base.why or doubt

    def _list_copy(self, base: ListValue) -> object:
        return self._list(self._iterate(base))

    def _dict_copy(self, base: DictValue) -> object:
        return self._dict(base)

    def _dict_get(self, base: DictValue, key: object, default: object = None) -> object:
        if base.why:
            raise UncertainError(base.why)
        return base.items.get(self._plain([key])[0], default)

    def _dict_setdefault(self, base: DictValue, key: object, default: object = None, *, doubt: str) -> object:
        if base.why:
            raise UncertainError(base.why)
        base.why = doubt
        return base.items.setdefault(self._plain([key])[0], default)

    def _dict_update(self, base: DictValue, more: object = None, /, *, doubt: str, **words: object) -> None:
        if more is not None and not isinstance(more, DictValue):
            raise UncertainError("an argument of update")
        self._budget.spend(8 * len(more.items) if more is not None else 0)
        base.items.update(more.items if more is not None else {})
        base.items.update(words)
        base.why = base.why or (more.why if more is not None else "") or doubt

    def _dict_items(self, base: DictValue) -> object:
        return ViewValue(base, "items")

    def _dict_keys(self, base: DictValue) -> object:
        return ViewValue(base, "keys")

    def _dict_values(self, base: DictValue) -> object:
        return ViewValue(base, "values")

    def _dict(self, more: object = None, /, **words: object) -> DictValue:
        found = DictValue()
        if isinstance(more, DictValue):
            self._dict_update(found, more, doubt="")
        elif more is not None:
            for pair in self._iterate(more):
                if isinstance(pair, Gap):
                    found.why = found.why or pair.why
                else:
                    key, value = self._iterate(pair)
                    found.items[self._plain([key])[0]] = value
        found.items.update(words)
        return found

    def _default_dict(self, factory: object, **words: object) -> DictValue:
        if factory != Known("builtins.list"):
            raise UncertainError("a default factory")
        return DictValue(dict(words.items()), has_default_list=True)

    # --- functions for all kinds --------------------------------------------------------------------------------------

    def _len(self, value: object) -> int:
        if isinstance(value, str):
            return len(value)
        value = value.base if isinstance(value, ViewValue) else value
        if isinstance(value, ListValue | DictValue) and not value.why:
            return len(value.items)
        raise UncertainError(getattr(value, "why", "") or "a length")

    def _bool(self, value: object = False) -> bool:
        return bool(*self._plain([value]))

    def _chain(self, parts: Iterator[object]) -> Iterator[object]:
        for part in parts:
            if isinstance(part, Gap):
                yield part
            else:
                yield from self._iterate(part)

    def _sorted(self, part: object, *, key: object = None, reverse: object = False) -> ListValue:
        found = self._list(self._iterate(part))
        with self._reader.doubting(found.why):
            keys = self._plain([one if key is None else self._reader.call(key, [one], {}) for one in found.items])
        self._budget.spend(10 * len(keys))
        order = sorted(range(len(keys)), key=keys.__getitem__, reverse=bool(*self._plain([reverse])))
        return ListValue([found.items[index] for index in order], why=found.why)

    def _reversed(self, part: object) -> object:
        if not isinstance(part, ListValue):
            part = self._list(self._iterate(part))
        return IteratorValue(self._backwards(part))

    def _backwards(self, part: ListValue) -> Iterator[object]:
        for index in reversed(range(len(part.items))):
            if part.why:
                yield Gap(part.why)
            if index < len(part.items):
                yield part.items[index]
        if part.why:
            yield Gap(part.why)

    def _enumerate(self, part: object, start: object = 0) -> object:
        (number,) = self._plain([start])
        return IteratorValue(self._numbered(part, int(number)))

    def _numbered(self, part: object, number: int) -> Iterator[object]:
        for element in self._iterate(part):
            if isinstance(element, Gap):
                yield element
            else:
                yield ListValue([number, element], is_tuple=True)
                number += 1

    def _zip(self, *parts: object) -> object:
        return IteratorValue(self._zipped(parts))

    def _zipped(self, parts: tuple[object, ...]) -> Iterator[object]:
        for elements in zip(*map(self._iterate, parts), strict=False):
            gaps = [element for element in elements if isinstance(element, Gap)]
            if gaps:
                for part in parts:  # how many elements are consumed is unknown
                    self._reader.touch(part, gaps[0].why)
                yield gaps[0]
                return
            yield ListValue([*elements], is_tuple=True)

    def _map(self, function: object, part: object) -> object:
        return IteratorValue(self._mapped(function, part))

    def _mapped(self, function: object, part: object) -> Iterator[object]:
        for element, why in self._reader.each(self._iterate(part)):
            if isinstance(element, Gap):
                yield element
                continue
            with self._reader.doubting(why):
                result = self._reader.call(function, [element], {})
            yield result

    def _filter(self, function: object, part: object) -> object:
        return IteratorValue(self._filtered(function, part))

    def _filtered(self, function: object, part: object) -> Iterator[object]:
        for element, why in self._reader.each(self._iterate(part)):
            if isinstance(element, Gap):
                yield element
                continue
            try:
                with self._reader.doubting(why):
                    result = element if function is None else self._reader.call(function, [element], {})
                (is_accepted,) = self._plain([result])
            except UncertainError as error:
                yield Gap(str(error))
                is_accepted = True
            if is_accepted:
                yield element

    def _range(self, *parts: object) -> range:
        return range(*self._plain([*parts]))

    def _sum(self, part: object, start: object = 0) -> object:
        total = start
        for element in self._iterate(part):
            if isinstance(element, Gap):
                raise UncertainError(element.why)
            total = self.operation("Add", total, element)
        return total

    def _any(self, part: object, wanted: bool) -> bool:
        for element in self._iterate(part):
            if isinstance(element, Gap):
                raise UncertainError(element.why)
            if bool(*self._plain([element])) is wanted:
                return True
        return False


def _text(value: object) -> str:
    """Return a text or path of setup.py as a text; raises `UncertainError` for another value."""
    if isinstance(value, str | PurePosixPath):
        return str(value)
    raise UncertainError(getattr(value, "why", "") or "a path that is not a text")


def _known(value: Any, why: str) -> Any:
    if value is None:
        raise UncertainError(why or "a file outside of the package folder")
    return value
