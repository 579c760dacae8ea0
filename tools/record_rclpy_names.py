"""Record the public names of Jazzy's rclpy in `tests/golden/rclpy_names.json`.

Run it as ``python tools/record_rclpy_names.py``.

They are those that programs can import or call: of each module all names without a leading underscore, also those that
it imports for itself, with kind, where they are defined, parameters and defaults; of each class that rclpy defines its
members, and the names with an underscore that its methods use. `describe` runs in the Python that has rclpy, from the
package index, and knows nothing of ours, so that it can describe anything else that calls itself rclpy in the same
words.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import pkgutil
import re
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

RECORD = Path(__file__).resolve().parents[1] / "tests/golden/rclpy_names.json"
KEPT = {"__init__", "__call__", "__enter__", "__exit__", "__await__", "__iter__", "__next__", "__len__", "__bool__"}
KEPT |= {"__eq__", "__ne__", "__lt__", "__le__", "__gt__", "__ge__", "__add__", "__radd__", "__sub__", "__hash__"}
"""Members with underscores that programs use anyway."""


def describe(package: str) -> dict[str, dict[str, Any]]:
    """Module -> name -> what it is, of a package that can be imported here."""
    root = importlib.import_module(package)
    names = [package, *(one.name for one in pkgutil.walk_packages(root.__path__, f"{package}."))]
    modules = (importlib.import_module(name) for name in names if not any(p[0] == "_" for p in name.split(".")))
    return {
        module.__name__: {
            name: _entry(thing, module.__name__, package)
            for name, thing in sorted(vars(module).items())
            if not name.startswith("_")
        }
        for module in modules
    }


def _entry(thing: Any, module: str, package: str) -> dict[str, Any]:
    found: dict[str, Any] = {"kind": kind_of(thing)}
    if found["kind"] == "module":
        return {**found, "from": thing.__name__}
    defined = getattr(thing, "__module__", None)
    if isinstance(defined, str) and defined != module and found["kind"] != "constant":
        found["from"] = defined
        if not defined.startswith(package):
            return found  # defined by another package
    if found["kind"] == "function":
        found["parameters"] = parameters_of(thing)
    elif found["kind"] == "class" and (
        "from" not in found or "._" in found["from"]
    ):  # of C, and described nowhere else
        found |= _class_entry(thing)
    elif found["kind"] == "constant" and isinstance(thing, (str, int, float, bool, type(None))):
        found["value"] = plain(thing)
    return found


def _class_entry(cls: type) -> dict[str, Any]:
    members: dict[str, Any] = {}
    for name, thing in sorted(vars(cls).items()):
        if name.startswith("_") and (name not in KEPT or thing is None):
            continue
        kind = kind_of(thing)
        members[name] = {"kind": kind}
        if kind == "function":
            members[name]["parameters"] = parameters_of(thing)
        elif type(thing) is cls and isinstance(getattr(thing, "value", None), (str, int)):
            members[name] = {"kind": "constant", "value": plain(thing.value)}  # of an enumeration
    bases = [f"{base.__module__}.{base.__qualname__}" for base in cls.__bases__ if base is not object]
    return {"bases": bases, "members": members, "private": private_names(cls)}


def private_names(cls: type) -> list[str]:
    """Names with an underscore that a class defines or that its methods use of `self`; none for a class of C."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(cls)))
    except (OSError, TypeError):
        return []
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            names.add(node.name)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in ("self", "cls"):
            names.add(node.attr)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
    return sorted(name for name in names if name.startswith("_") and not name.endswith("__"))


def kind_of(thing: Any) -> str:
    """``class``, ``function``, ``property``, ``module`` or ``constant``; what `typing` makes is a constant."""
    if isinstance(thing, (staticmethod, classmethod)) or (inspect.isroutine(thing) and callable(thing)):
        return "function"
    if inspect.isclass(thing):
        return "class"
    if hasattr(type(thing), "__get__"):
        return "property"
    return "module" if inspect.ismodule(thing) else "constant"


def parameters_of(function: Any) -> str | None:
    """Return ``self, name, *, context=None`` without annotations; None if a C function has no signature."""
    function = getattr(function, "__func__", function)
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return None
    empty = inspect.Parameter.empty
    bare = [one.replace(annotation=empty) for one in signature.parameters.values()]
    text = str(signature.replace(parameters=bare, return_annotation=inspect.Signature.empty))
    return re.sub(r" at 0x[0-9a-f]+", "", text[1:-1])


def plain(value: Any) -> Any:
    """Without the class of an enumeration."""
    for kind in (str, int, float):
        if isinstance(value, kind) and not isinstance(value, bool):
            return kind.__str__(value) if kind is str else kind(value)
    return value


def record(python: Path) -> str:
    code = "import json; from record_rclpy_names import describe; print(json.dumps(describe('rclpy')))"
    run = subprocess.run(
        [str(python), "-W", "ignore", "-c", code],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    return json.dumps(json.loads(run.stdout), indent=1, sort_keys=True) + "\n"


if __name__ == "__main__":
    sys.path.insert(0, str(RECORD.parents[1]))
    from support.environments import rclpy_python

    RECORD.write_text(record(rclpy_python()), encoding="utf-8")
    print(f"wrote {RECORD}")
