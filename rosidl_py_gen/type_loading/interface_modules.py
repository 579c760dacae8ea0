"""The module of one interface in rosidl's place, such as ``std_msgs.msg._string``, made in memory.

Classes of rclpy's flavour are defined there, so that a program sees what a ROS installation would show it. Our own are
those of `by_name`, which a module then only hands on. Decides what a module is made of, and that it is compiled once.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import CodeType, ModuleType
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import RosName, py_name, snake_case, split_ros_name
from rosidl_py_gen.type_loading import code_cache
from rosidl_py_gen.type_loading.class_lookup import get_action, get_message, get_service

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.compiler.codegen.layout_planner import LayoutPlanner
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry
    from rosidl_py_gen.compiler.frontend.search_path import SearchPath

_OF_SERVICES = ("", "_Request", "_Response", "_Event")
_PARTS = {
    "msg": ("",),
    "srv": _OF_SERVICES,
    "action": (
        *("", "_Goal", "_Result", "_Feedback", "_FeedbackMessage"),
        *(f"_{service}{part}" for service in ("SendGoal", "GetResult") for part in _OF_SERVICES),
    ),
}
"""What follows the name of an interface in the names of its classes, by kind."""
_SERVICES = {"_SendGoal", "_GetResult"}
_GET: dict[str, Callable[..., type]] = {"msg": get_message, "srv": get_service, "action": get_action}


class Interfaces:
    """The interfaces of a search path, and their modules."""

    def __init__(self, search: SearchPath, folders: Sequence[str]) -> None:
        self.search = search
        self._folders = folders
        self._lock = threading.RLock()
        self._digests: dict[str, str] = {}
        self._registry: InterfaceRegistry | None = None
        self._layouts: LayoutPlanner | None = None

    def kinds(self, package: str) -> set[str]:
        """The kinds of interfaces in a package."""
        found = self.search.packages.get(package)
        return {name.kind for name in found.files} if found else set()

    def modules(self, package: str, kind: str) -> dict[str, list[RosName]]:
        """Modules of a package's folder, and the interfaces in each: one, unless two have names too much alike."""
        found: dict[str, list[RosName]] = {}
        for name in self.search.packages[package].files:
            if name.kind == kind:
                found.setdefault("_" + snake_case(name.name), []).append(name)
        return found

    def classes(self, package: str, kind: str) -> dict[str, str]:
        """Every class of a package's folder, and the module that has it."""
        return {
            py_name(name.name + part): module
            for module, names in self.modules(package, kind).items()
            for name in names
            for part in _PARTS[kind]
        }

    def fill(self, module: ModuleType, name: RosName, made: tuple[code_cache.Parts, CodeType] | None) -> None:
        """Put the classes of an interface into its module: those that `code` made, or else our own.

        Raises:
            DefinitionError: the definition has problems.
        """
        if made is not None:
            exec(made[1], module.__dict__)
            return
        for part in _PARTS[name.kind]:
            get = get_service if part in _SERVICES else get_message if part else _GET[name.kind]
            module.__dict__[py_name(name.name + part)] = get(f"{name}{part}", path=self._folders)
        module.__dict__["__all__"] = [py_name(name.name + part) for part in _PARTS[name.kind]]

    def code(self, name: RosName) -> tuple[code_cache.Parts, CodeType]:
        """The compiled module in rclpy's flavour, and what it was made of; from the cache if it is there.

        Raises:
            DefinitionError: the definition has problems.
        """
        with self._lock:
            text_digest = self._digest(str(name))
            found = code_cache.load(str(name), text_digest, self._digest)
            if found is None:
                found = self._compiled(name)
                code_cache.store(str(name), text_digest, *found)
            return found

    def _digest(self, interface: str) -> str:
        if interface not in self._digests:
            file = self.search.file(split_ros_name(interface))
            try:
                content = f"{file.suffix}\n".encode() + file.read_bytes() if file is not None else b""
            except OSError:
                content = b""
            self._digests[interface] = code_cache.digest(content) if content else ""
        return self._digests[interface]

    def _compiled(self, name: RosName) -> tuple[code_cache.Parts, CodeType]:
        from rosidl_py_gen.compiler.codegen.layout_planner import LayoutPlanner
        from rosidl_py_gen.compiler.codegen.module_sources import module_source
        from rosidl_py_gen.compiler.codegen.template_model import Target, module_path
        from rosidl_py_gen.compiler.frontend.definition_text import read_checked
        from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry

        if self._registry is None or self._layouts is None:
            self._registry = InterfaceRegistry(self.search)
            self._layouts = LayoutPlanner(self._registry.message, rclpy=True)
        registry = self._registry
        try:
            read_checked(registry, name)
        except BaseException:
            self._registry = None  # what was read half must not be used later
            raise
        target = Target("", lambda _: None, registry.type_hash, is_typed=False)
        source = module_source(registry, name, self._layouts, target)
        owners = {registry.owner(split_ros_name(part)) for part in registry.all_hashes(str(name))}
        parts = {str(owner): self._digest(str(owner)) for owner in owners if owner is not None}
        return parts, compile(source, f"<{module_path(str(name))}>", "exec")
