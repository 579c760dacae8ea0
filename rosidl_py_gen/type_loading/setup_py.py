"""Arguments of `setup` in a setup.py, read from its syntax tree without running it.

Values are strings, lists and dicts, made of literals, variables, formatting, `os.path.join`, `glob` and
`find_packages`. Another expression has the value None.
"""

from __future__ import annotations

import ast
import glob
import os
import re
from collections.abc import Sequence
from fnmatch import fnmatchcase
from itertools import islice
from pathlib import Path

from rosidl_py_gen.compiler.frontend.cmake_reader import inside
from rosidl_py_gen.errors import RosidlError

_MAX_FILES = 10_000
"""Maximum files that one `glob` returns; more than a package installs."""
_ONLY_PERCENT_S = re.compile(r"(?:[^%]|%s)*")
_ONLY_NUMBERS_IN_BRACES = re.compile(r"(?:[^{}]|\{\d{0,3}\})*")
_PATH_NAMES = ("join", "glob")
_FIND_NAMES = ("find_packages", "find_namespace_packages")


class SetupSyntaxError(RosidlError):
    """A setup.py is not Python, or nested too deeply."""


def setup_calls(text: str, folder: Path) -> list[dict[str, object]]:
    """Return the keyword arguments of each call of `setup`; raises `SetupSyntaxError`."""
    try:
        tree = ast.parse(text)
        return _Reader(folder).calls(tree)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise SetupSyntaxError(str(error)) from error


class _Reader:
    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._names: dict[str, object] = {}

    def calls(self, tree: ast.Module) -> list[dict[str, object]]:
        for node in ast.walk(tree):
            self._assign(node)
        found = []
        for node in ast.walk(tree):
            called = node.func if isinstance(node, ast.Call) else None
            if getattr(called, "id", getattr(called, "attr", None)) != "setup":
                continue
            assert isinstance(node, ast.Call)
            given = {word.arg: self._value(word.value) for word in node.keywords if word.arg is not None}
            for word in node.keywords:
                if word.arg is None and isinstance(more := self._value(word.value), dict):  # setup(**arguments)
                    given.update(more)
            found.append(given)
        return found

    def _assign(self, node: ast.AST) -> None:
        """Record the value of a variable, and values that are added to a list."""
        match node:
            case ast.Assign(targets=targets, value=value):
                for target in targets:
                    if isinstance(target, ast.Name):
                        self._names.setdefault(target.id, self._value(value))
            case ast.AugAssign(target=ast.Name(id=name), op=ast.Add(), value=value):
                self._extend(name, self._value(value))
            case ast.Call(func=ast.Attribute(value=ast.Name(id=name), attr="extend"), args=[value]):
                self._extend(name, self._value(value))
            case ast.Call(func=ast.Attribute(value=ast.Name(id=name), attr="append"), args=[value]):
                self._extend(name, [self._value(value)])

    def _extend(self, name: str, more: object) -> None:
        known = self._names.get(name)
        if isinstance(known, list) and isinstance(more, list):
            self._names[name] = known + more

    def _value(self, node: ast.expr) -> object:
        match node:
            case ast.Constant(value=str(text)):
                return text
            case ast.Name(id=name):
                return self._names.get(name)
            case ast.List(elts=parts) | ast.Tuple(elts=parts):
                return self._list(parts)
            case ast.Dict(keys=keys, values=values):
                read = [(self._value(key), self._value(one)) for key, one in zip(keys, values, strict=True) if key]
                return {key: value for key, value in read if isinstance(key, str)}
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                first, second = self._value(left), self._value(right)
                if isinstance(first, list) and isinstance(second, list):
                    return first + second
                return first + second if isinstance(first, str) and isinstance(second, str) else None
            case ast.BinOp(left=left, op=ast.Mod(), right=right):
                return _percent(self._value(left), self._value(right))
            case ast.JoinedStr(values=pieces):
                words = [self._value(one.value if isinstance(one, ast.FormattedValue) else one) for one in pieces]
                return "".join(_texts(words)) if _texts(words) else None
            case ast.Call(func=ast.Attribute(value=ast.Constant(value=str(text)), attr="format"), args=parts):
                return None if node.keywords else _formatted(text, self._list(parts))
            case ast.Call(func=ast.Name(id="dict"), args=[], keywords=words):
                return {word.arg: self._value(word.value) for word in words if word.arg is not None}
            case ast.Call(func=ast.Name(id="str" | "list" | "sorted" | "tuple"), args=[part], keywords=[]):
                return self._value(part)
            case ast.Call(func=ast.Attribute(attr=name) | ast.Name(id=name), args=parts) if name in _PATH_NAMES:
                return self._path(name, self._list(parts), node)
            case ast.ListComp(
                elt=ast.Name(id=name), generators=[ast.comprehension(target=ast.Name(id=same), iter=part)]
            ):
                return self._value(part) if name == same else None
            case ast.Call(func=ast.Attribute(attr=name) | ast.Name(id=name)) if name in _FIND_NAMES:
                return self._packages(node, "__init__.py" if name == "find_packages" else "*")
        return None

    def _packages(self, node: ast.Call, wanted: str) -> object:
        """Return the result of `find_packages` without inner packages."""
        given = dict(zip(("where", "exclude", "include"), map(self._value, node.args), strict=False))
        given |= {word.arg: self._value(word.value) for word in node.keywords if word.arg is not None}
        where, excluded, included = given.get("where", "."), given.get("exclude", []), given.get("include", ["*"])
        if not (isinstance(where, str) and isinstance(excluded, list) and isinstance(included, list)):
            return None
        found = self._glob(os.path.join(where, "*", wanted)) or []
        names = dict.fromkeys(os.path.basename(os.path.dirname(file)) for file in found)
        kept = [name for name in names if any(fnmatchcase(name, str(pattern)) for pattern in included)]
        return [name for name in kept if not any(fnmatchcase(name, str(pattern)) for pattern in excluded)]

    def _glob(self, pattern: str, *, is_deep: bool = False) -> list[str] | None:
        """Return the files of the package that match a pattern; None if it leads out of the package's folder."""
        path = inside(pattern.replace(os.sep, "/"))
        found = None if path is None else glob.iglob(path, root_dir=self._folder, recursive=is_deep)
        return None if found is None else sorted(islice(found, _MAX_FILES))

    def _list(self, parts: list[ast.expr]) -> list[object]:
        found: list[object] = []
        for part in parts:
            if isinstance(part, ast.Starred):
                more = self._value(part.value)
                found += more if isinstance(more, list) else [None]
            else:
                found.append(self._value(part))
        return found

    def _path(self, name: str, values: list[object], node: ast.Call) -> object:
        """Return the result of `os.path.join` or `glob`; `glob` searches only the package's folder."""
        texts = _texts(values)
        if not texts:
            return None
        if name == "join":
            return os.path.join(*texts)
        is_deep = any(word.arg == "recursive" for word in node.keywords)
        return None if len(texts) > 1 else self._glob(texts[0], is_deep=is_deep)


def _percent(text: object, values: object) -> str | None:
    parts = _texts(values if isinstance(values, list) else [values])
    if not isinstance(text, str) or not _ONLY_PERCENT_S.fullmatch(text) or text.count("%s") != len(parts):
        return None
    return text % tuple(parts)


def _formatted(text: str, values: list[object]) -> str | None:
    if not _ONLY_NUMBERS_IN_BRACES.fullmatch(text):  # a width could make the text of any length
        return None
    try:
        return text.format(*_texts(values))
    except (IndexError, ValueError):  # too few values, or numbers in some braces only
        return None


def _texts(values: Sequence[object]) -> list[str]:
    """Return the values if all are texts, else none."""
    texts = [value for value in values if isinstance(value, str)]
    return texts if len(texts) == len(values) else []
