"""Private names of classes that programs derive from or add attributes to: ours have a prefix, or exist in rclpy.

A program may use any other name. See `programs/values_subclasses.py` for the effect.
"""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path
from typing import Any

from record_rclpy_names import RECORD

import rosidl_py_gen

FOLDER = Path(rosidl_py_gen.__file__).parent / "ros_compat"
REAL: dict[str, dict[str, Any]] = json.loads(RECORD.read_text(encoding="utf-8"))
PREFIX = re.compile(r"_rosidl_|_ROSIDL_|__\w+__$")
INTERNAL = (
    "rclpy._classes",
    "rclpy.entity_execution",
    "rclpy.handles",
    "rclpy.impl.",
    "rosidl_runtime_py",
)
"""Modules whose classes programs neither derive from nor get."""
INTERNAL_CLASSES = {"TimerHandle", "ClockHandle", "EventHandle", "GuardConditionHandle", "WaitSet"}
INTERNAL_CLASSES |= {
    "LifecycleStateMachine",
    "_OldName",
    "_RuntimeProfile",
    "TransformRegistration",
    "ConvertRegistration",
}
OF_COMPANIONS = {
    "BufferCore": {"_frameExists", "_getFrameStrings"},
    "Buffer": {"_new_data_callbacks"},
    "Arcball": {"_axes", "_axis", "_center", "_constrain", "_qdown", "_qnow", "_qpre", "_radius", "_vdown"},
}
"""Names with an underscore of packages other than rclpy."""

PARTS = {
    "NodeParameters": ["Node"],
    "BaseNode": ["Node"],
    "AsyncNode": ["Node"],
    "BaseClient": ["Client"],
    "BaseClock": ["Clock", "ROSClock"],
    "BasePublisher": ["Publisher"],
    "BaseService": ["Service"],
    "BaseSubscription": ["Subscription"],
    "BaseTimer": ["Timer"],
    "ActionWaitable": ["ActionClient", "ActionServer"],
    "SingleThreadedExecutor": ["Executor"],
}
"""Our mixins and bases -> classes of rclpy."""


def private_names(cls: ast.ClassDef) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(cls):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in ("self", "cls"):
            names.add(node.attr)
    for part in cls.body:
        targets = (
            part.targets if isinstance(part, ast.Assign) else [part.target] if isinstance(part, ast.AnnAssign) else []
        )
        names |= {one.id for one in targets if isinstance(one, ast.Name)}
    return {name for name in names if name.startswith("_") and not PREFIX.match(name)}


def known(cls: ast.ClassDef) -> set[str]:
    """Return the private names of the real class, its bases, and the class it is a mixin of."""
    names: set[str] = set()
    bases = [re.sub(r"\[.*", "", ast.unparse(base)) for base in cls.bases]
    for name in (cls.name, *bases, *PARTS.get(cls.name, ())):
        entries = [there[name] for there in REAL.values() if "private" in there.get(name, {})]
        names |= OF_COMPANIONS.get(name, set()).union(*(entry["private"] for entry in entries))
    return {name for name in names if not name.startswith("__")}


def test_private_names_exist_in_rclpy_or_have_reserved_prefix() -> None:
    found = {}
    for file in FOLDER.rglob("*.py"):
        module = ".".join(file.relative_to(FOLDER).with_suffix("").parts)
        for cls in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if not isinstance(cls, ast.ClassDef) or cls.name in INTERNAL_CLASSES:
                continue
            if module.startswith(INTERNAL) and cls.name != "ActionWaitable":
                continue
            if names := private_names(cls) - known(cls):
                found[f"{module}.{cls.name}"] = sorted(names)
    assert found == {}
