"""Packages whose modules load when a name is first used (PEP 562), so that importing `sensor_msgs.msg` is cheap.

The names come from a mapping, in generated packages, or from the package's stub file, which type checkers read as
well: `from MODULE import NAME as NAME`, one name for each import. Names below the first comment of a stub file are for
other packages of rosidl_py_gen, and not public.

Thread: any. The import system makes threads wait for a module that another one imports, so all get the same object.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping


def lazy_exports(package: str, modules: Mapping[str, str]) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Return functions `__getattr__` and `__dir__` for a package that imports its modules at the first use of a name.

    `modules` has the name of the module inside the package for each exported name.
    """
    return _exports(package, {name: f"{package}.{module}" for name, module in modules.items()})


def stub_exports(package: str) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__`, `__all__` for a package that lazily imports names of its ``__init__.pyi``.

    `__dir__` and `__all__` have the public names only.
    """
    # Not lazy_loader 0.6: it refuses stubs with names of other packages (here `rosidl_py_gen.errors`) or in zip files.
    spec: Any = sys.modules[package].__spec__
    text = spec.loader.get_data(f"{spec.origin}i").decode()  # out of a zip file, too
    public, _, others = (_homes(part) for part in text.partition("#"))
    return *_exports(package, public | others, public), sorted(public)


def _homes(stub: str) -> dict[str, str]:
    """Return the modules of the names that a part of a stub file imports."""
    lines = stub.replace("(\n", "").splitlines()  # a long name stands on a line of its own, in parentheses
    return {words[3]: words[1] for words in map(str.split, lines) if words[:1] == ["from"]}


def _exports(
    package: str, homes: Mapping[str, str], public: Iterable[str] | None = None
) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    def module_getattr(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        try:
            module = import_module(homes[name])
        except AttributeError as error:  # `from PACKAGE import NAME` would report a missing name, without the cause
            raise ImportError(f"{homes[name]}: {error}") from error
        value = getattr(module, name)
        setattr(sys.modules[package], name, value)
        return value

    shown = homes.keys() if public is None else public

    def module_dir() -> list[str]:
        return sorted({*(vars(sys.modules[package]).keys() - homes.keys()), *shown})

    return module_getattr, module_dir
