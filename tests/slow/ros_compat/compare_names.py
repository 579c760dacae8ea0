"""Differences between the names of our rclpy and the recorded ones, in JSON. Run by ``rosidl-py run``."""

from __future__ import annotations

import enum
import importlib
import inspect
import json
import sys
import typing
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

TESTS = Path(__file__).resolve().parents[2]
sys.path += [str(TESTS), str(TESTS.parent / "tools")]

from record_lyrical_names import RECORD as LYRICAL_RECORD  # noqa: E402
from record_rclpy_names import RECORD, describe, kind_of, parameters_of, plain  # noqa: E402

REAL: dict[str, dict[str, Any]] = json.loads(RECORD.read_text(encoding="utf-8"))
LYRICAL: dict[str, list[str] | None] = json.loads(LYRICAL_RECORD.read_text(encoding="utf-8"))


def of_python(name: str, entry: dict[str, Any]) -> bool:
    if defined := entry.get("from"):
        return str(defined).partition(".")[0] in sys.stdlib_module_names
    return entry["kind"] == "constant" and "value" not in entry and name in vars(typing)


def find_member(holder: Any, name: str) -> tuple[bool, Any]:
    """Return True if a module or class has a name, and its value, which is None if only instances have it."""
    if not inspect.isclass(holder):
        return hasattr(holder, name), getattr(holder, name, None)
    instances = {one for base in holder.__mro__ for one in vars(base).get("__annotations__", ())}
    if name in instances or (issubclass(holder, enum.Enum) and name in ("name", "value")):
        return True, None
    return hasattr(holder, name), inspect.getattr_static(holder, name, None)


def compare(path: str, entry: dict[str, Any], thing: Any) -> Iterator[tuple[str, str, Any]]:
    """Yield differences: ``(path, aspect, our value)``."""
    if entry["kind"] != "property" and kind_of(thing) != entry["kind"]:
        yield path, "kind", kind_of(thing)
    parameters = entry.get("parameters")
    own = parameters_of(thing) if parameters is not None else None
    if own != parameters and not path.endswith(".__ne__") and not _adds_lyrical_parameters(path, thing, parameters):
        yield path, "parameters", parameters_of(thing)
    if "value" in entry and plain(getattr(thing, "value", thing)) != entry["value"]:
        yield path, "value", thing
    for name, member in entry.get("members", {}).items():
        there, one = find_member(thing, name)
        if not there:
            yield f"{path}.{name}", "missing", None
        elif one is not None:
            yield from compare(f"{path}.{name}", member, one)


def _parameter_names(thing: Any) -> list[str]:
    return list(inspect.signature(getattr(thing, "__func__", thing)).parameters)


def _adds_lyrical_parameters(path: str, thing: Any, recorded: str) -> bool:
    """Return True if a function has the parameters of Jazzy, and more parameters of Lyrical."""
    lyrical = {name.rstrip("=") for name in LYRICAL.get(path) or ()}
    old = [part.partition("=")[0].strip("* ") for part in recorded.split(", ") if part != "*"]
    own = _parameter_names(thing)
    return bool(lyrical) and [name for name in own if name in old or name not in lyrical] == old


def lyrical_differences() -> Iterator[tuple[str, str]]:
    """Yield the names of Lyrical's rclpy that are missing, and the missing parameters as ``path(name)``."""
    missing: set[str] = set()
    modules = {
        *REAL,
        *(path for path in LYRICAL if path.islower() and any(name.startswith(f"{path}.") for name in LYRICAL)),
    }
    for path, parameters in LYRICAL.items():
        if path.rpartition(".")[0] in missing:
            continue  # a member of a missing class
        module = max((name for name in modules if f"{path}.".startswith(f"{name}.")), key=len)
        thing: Any = importlib.import_module(module)
        for part in filter(None, path.removeprefix(module).split(".")):
            there, thing = find_member(thing, part)
            if not there:
                missing.add(path)
                yield path, "missing"
                break
            if thing is None:
                break
        else:
            if parameters is not None and inspect.isroutine(thing):
                own = _parameter_names(thing)
                if "kwargs" not in own:
                    names = [name.rstrip("=") for name in parameters]
                    lacking = [name for name in names if name not in (*own, "cls", "self")]
                    yield from ((f"{path}({name})", "parameter") for name in lacking)


def differences() -> Iterator[tuple[str, str, Any]]:
    modules = {name: importlib.import_module(name) for name in REAL}  # all, before any is asked for its submodules
    for module_name, names in REAL.items():
        module = modules[module_name]
        for name, entry in names.items():
            there, thing = find_member(module, name)
            if not there:
                yield f"{module_name}.{name}", "missing", None
            elif not of_python(name, entry):
                yield from compare(f"{module_name}.{name}", entry, thing)


def members_of(module: str, name: str, seen: tuple[str, ...] = ()) -> set[str]:
    entry = REAL.get(module, {}).get(name)
    if entry is None or f"{module}.{name}" in seen:
        return set()
    seen = (*seen, f"{module}.{name}")
    if "members" not in entry:
        return members_of(entry["from"], name, seen) if "from" in entry else set()
    bases = (base.rpartition(".") for base in entry["bases"])
    return set(entry["members"]).union(*(members_of(base, last, seen) for base, _, last in bases))


def more() -> Iterator[str]:
    """Yield public names that our modules define and rclpy does not have, without imported names."""
    for module_name, names in describe("rclpy").items():
        if module_name not in REAL:
            if module_name not in LYRICAL:
                yield module_name
            continue
        for name, entry in names.items():
            recorded = REAL[module_name].get(name)
            if recorded is None:
                imported = entry["kind"] == "module" or "from" in entry or name == "annotations" or name in vars(typing)
                if not imported and f"{module_name}.{name}" not in LYRICAL:
                    yield f"{module_name}.{name}"
            elif "members" in recorded and "members" in entry:
                cls = getattr(importlib.import_module(module_name), name)
                own = {one for base in cls.__mro__ if base.__module__.startswith("rclpy") for one in vars(base)}
                known = members_of(module_name, name)
                extra = (one for one in sorted(own - known) if not one.startswith(("_", "rosidl_")))
                added = (f"{module_name}.{name}.{one}" for one in extra)
                yield from (path for path in added if path not in LYRICAL)


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # deprecated modules and names are looked at, too
    different = [(path, aspect, str(ours)) for path, aspect, ours in differences()]
    lyrical = list(lyrical_differences())
    print(json.dumps({"different": different, "more": list(more()), "lyrical": lyrical}))
