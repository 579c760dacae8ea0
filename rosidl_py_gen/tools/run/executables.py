"""The executables of a package, read from its sources: nothing of them is run.

Console scripts of setup.py (by its syntax tree), setup.cfg and pyproject.toml, and the files that CMakeLists.txt
installs as PROGRAMS into ``lib/<package>``. An installed package has the console scripts of its distribution, and
what is in ``lib/<package>`` of its prefix.
"""

from __future__ import annotations

import ast
import configparser
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise, takewhile
from pathlib import Path

from rosidl_py_gen.compiler.spec.cmake import Script, inside
from rosidl_py_gen.compiler.spec.files import MAX_BYTES, UnreadableError, read_text
from rosidl_py_gen.tools import ToolError

_ENTRY = re.compile(r"\s*([^\s=]+)\s*=\s*([\w.]+)\s*:\s*([\w.]+)\s*(?:\[.*\])?\s*")
_TOML_LINE = re.compile(r"""\s*(?:"([^"]+)"|'([^']+)'|([\w-]+))\s*=\s*(?:"([^"\\]*)"|'([^']*)')\s*(?:#.*)?""")
_LIST_ENDS = ("DESTINATION", "PERMISSIONS", "CONFIGURATIONS", "COMPONENT", "RENAME", "OPTIONAL", "TYPE")
_GROUP = "console_scripts"


@dataclass(frozen=True)
class Executable:
    """One executable.

    Attributes:
        name: what `ros2 run` calls it.
        folder: is put in front of `sys.path`.
        source: the file that names it.
        file: the script that is run, or None.
        module: has the function that is called, or None.
        function: with dots for attributes, or None.
    """

    name: str
    folder: Path
    source: Path
    file: Path | None = None
    module: str | None = None
    function: str | None = None


def of_sources(folder: Path) -> dict[str, Executable]:
    """The executables of a source package by name.

    Raises:
        ToolError: a file that names them cannot be read.
    """
    found: dict[str, Executable] = {}
    for reader, name in ((_setup_py, "setup.py"), (_setup_cfg, "setup.cfg"), (_pyproject, "pyproject.toml")):
        if (folder / name).is_file():
            texts, root = reader(_text(folder, name), folder / name)
            for one in _scripts(texts, folder / root, folder / name):
                found.setdefault(one.name, one)
    if (folder / "CMakeLists.txt").is_file():
        for one in _programs(folder):
            found.setdefault(one.name, one)
    return found


def of_distribution(package: str) -> dict[str, Executable]:
    """The console scripts of a package that pip installed."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        installed = distribution(package)
    except PackageNotFoundError:
        return {}
    place = Path(str(installed.locate_file("")))
    texts = [f"{one.name} = {one.value}" for one in installed.entry_points if one.group == _GROUP]
    return {one.name: one for one in _scripts(texts, place, place)}


def of_prefixes(package: str) -> dict[str, Executable]:
    """What AMENT_PREFIX_PATH has of a package in ``lib/<package>``."""
    found: dict[str, Executable] = {}
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        folder = Path(prefix, "lib", package)
        try:
            names = sorted(os.listdir(folder))
        except OSError:
            continue
        for name in names:
            path = folder / name
            if path.is_file() and os.access(path, os.X_OK):
                found.setdefault(name, Executable(name, folder, folder, file=path))
    return found


def _text(folder: Path, name: str) -> str:
    try:
        return read_text(folder, name)
    except UnreadableError as error:
        raise ToolError(f"{folder / name}: {error.reason}") from error


def _scripts(texts: Iterable[str], folder: Path, source: Path) -> Iterator[Executable]:
    for text in texts:
        found = _ENTRY.fullmatch(text)
        if found is None:
            if text.strip():
                raise ToolError(f'{source}: expected "name = module:function", found "{text.strip()[:200]}"')
            continue
        yield Executable(found[1], folder, source, module=found[2], function=found[3])


# --- setup.py ---------------------------------------------------------------------------------------------------------


def _setup_py(text: str, source: Path) -> tuple[list[str], str]:
    """Console scripts, and where modules are below the package's folder."""
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise ToolError(f"{source}: {error}") from error
    names: dict[str, object] = {}
    texts: list[str] = []
    root = ""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign):
            for target in node.targets:
                if isinstance(target, ast.Name):
                    names.setdefault(target.id, _value(node.value, names))
    for node in ast.walk(tree):
        called = node.func if isinstance(node, ast.Call) else None
        if getattr(called, "id", getattr(called, "attr", None)) != "setup":
            continue
        assert isinstance(node, ast.Call)
        given = {word.arg: _value(word.value, names) for word in node.keywords if word.arg is not None}
        for word in node.keywords:
            if word.arg is None and isinstance(more := _value(word.value, names), dict):  # setup(**arguments)
                given.update(more)
        points = given.get("entry_points")
        listed = points.get(_GROUP) if isinstance(points, dict) else None
        if isinstance(points, str):
            listed = _section(points, _GROUP)
        if isinstance(listed, str):
            listed = listed.splitlines()
        texts += [one for one in listed or () if isinstance(one, str)] if isinstance(listed, list | tuple) else []
        folders = given.get("package_dir")
        if isinstance(folders, dict) and isinstance(folders.get(""), str):
            root = folders[""]
    return texts, root


def _value(node: ast.expr, names: dict[str, object]) -> object:
    """What an expression of strings, lists and dicts is; None for what would have to be run."""
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.Name(id=name):
            return names.get(name)
        case ast.List(elts=parts) | ast.Tuple(elts=parts):
            return [_value(part, names) for part in parts]
        case ast.Dict(keys=keys, values=values):
            read = [(_value(key, names), _value(value, names)) for key, value in zip(keys, values, strict=True) if key]
            return {key: value for key, value in read if isinstance(key, str)}
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            first, second = _value(left, names), _value(right, names)
            if isinstance(first, list) and isinstance(second, list):
                return first + second
            return first + second if isinstance(first, str) and isinstance(second, str) else None
        case ast.BinOp(left=left, op=ast.Mod(), right=right):
            return _percent(_value(left, names), _value(right, names))
        case ast.JoinedStr(values=pieces):
            read_pieces = [
                _value(piece.value if isinstance(piece, ast.FormattedValue) else piece, names) for piece in pieces
            ]
            whole = [piece for piece in read_pieces if isinstance(piece, str)]
            return "".join(whole) if len(whole) == len(read_pieces) else None
        case ast.Call(func=ast.Attribute(value=ast.Constant(value=str(text)), attr="format"), args=parts, keywords=[]):
            return _formatted(text, [_value(part, names) for part in parts])
        case ast.Call(func=ast.Name(id="dict"), args=[], keywords=words):
            return {word.arg: _value(word.value, names) for word in words if word.arg is not None}
    return None


def _percent(text: object, values: object) -> str | None:
    parts = values if isinstance(values, list) else [values]
    if not isinstance(text, str) or text.replace("%s", "").count("%") or text.count("%s") != len(parts):
        return None
    return _filled(text.split("%s"), parts)


def _formatted(text: str, values: list[object]) -> str | None:
    pieces = re.split(r"\{(\d*)\}", text)
    if any("{" in piece or "}" in piece for piece in pieces[::2]):
        return None
    asked = [int(number or index) for index, number in enumerate(pieces[1::2]) if len(number) < 4]
    chosen = [values[index] for index in asked if index < len(values)]
    return _filled(pieces[::2], chosen) if len(chosen) == len(pieces[1::2]) else None


def _filled(pieces: list[str], values: list[object]) -> str | None:
    texts = [value for value in values if isinstance(value, str)]
    if len(texts) != len(values):
        return None
    return pieces[0] + "".join(value + piece for value, piece in zip(texts, pieces[1:], strict=True))


# --- setup.cfg, pyproject.toml ----------------------------------------------------------------------------------------


def _setup_cfg(text: str, source: Path) -> tuple[list[str], str]:
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    try:
        parser.read_string(text)
    except configparser.Error as error:
        raise ToolError(f"{source}: {error}".replace("\n", " ")) from error
    root = re.search(r"^\s*=\s*(\S+)", parser.get("options", "package_dir", fallback=""), re.MULTILINE)
    return parser.get("options.entry_points", _GROUP, fallback="").splitlines(), root[1] if root else ""


def _pyproject(text: str, source: Path) -> tuple[list[str], str]:
    """The lines of the table ``[project.scripts]``; Python 3.10 has no parser for all of TOML."""
    lines = (_TOML_LINE.fullmatch(line) for line in _section(text, "project.scripts"))
    texts = [f"{one[1] or one[2] or one[3]} = {one[4] or one[5] or ''}" for one in lines if one]
    return texts, "" if not (source.parent / "src").is_dir() else "src"


def _section(text: str, name: str) -> list[str]:
    """The lines below ``[name]``."""
    found: list[str] = []
    is_inside = False
    for line in text.splitlines():
        if line.lstrip().startswith("["):
            is_inside = line.strip().partition("]")[0].lstrip("[").strip() == name
        elif is_inside:
            found.append(line)
    return found


# --- CMakeLists.txt ---------------------------------------------------------------------------------------------------


def _programs(folder: Path) -> Iterator[Executable]:
    """The files that ``install(PROGRAMS ...)`` lists."""
    source = folder / "CMakeLists.txt"
    if source.stat().st_size > MAX_BYTES:
        raise ToolError(f"{source}: the file is longer than {MAX_BYTES} bytes")
    try:
        calls = Script(folder, _text(folder, source.name)).calls
    except UnreadableError as error:
        raise ToolError(f"{source}: {error.reason}") from error
    for texts in [[word.text for word in words] for name, words in calls if name == "install"]:
        if texts[:1] != ["PROGRAMS"]:
            continue
        renamed = dict(pairwise(texts)).get("RENAME")
        for path in map(inside, takewhile(lambda text: text not in _LIST_ENDS, texts[1:])):
            if path is not None and (folder / path).is_file():
                file = folder / path
                yield Executable(renamed or file.name, folder, source, file=file)
