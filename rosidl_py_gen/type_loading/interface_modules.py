"""Modules of interfaces with the names that rosidl gives them, such as ``std_msgs.msg._string``, with contents made in
memory.

A module defines the classes of rclpy's API, so that a program sees the same names as with a ROS installation, or
exports the native classes of `class_lookup`.
"""

from __future__ import annotations

import threading
from types import CodeType, ModuleType
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import RosName, py_name
from rosidl_py_gen.type_loading import disk_cache
from rosidl_py_gen.type_loading.class_lookup import ClassSearch

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.compiler.codegen import ModuleSources
    from rosidl_py_gen.compiler.frontend import InterfaceRegistry, SearchPath

_SERVICE_SUFFIXES = ("", "_Request", "_Response", "_Event")
_SUFFIXES = {
    "msg": ("",),
    "srv": _SERVICE_SUFFIXES,
    "action": (
        *("", "_Goal", "_Result", "_Feedback", "_FeedbackMessage"),
        *(f"_{service}{part}" for service in ("SendGoal", "GetResult") for part in _SERVICE_SUFFIXES),
    ),
}
"""Name suffixes of the classes of an interface, by kind."""


class Interfaces:
    """Interfaces of a search path and the contents of their modules.

    `distro` is the explicitly selected distribution, or None.
    """

    def __init__(self, search: SearchPath, folders: Sequence[str], distro: str | None = None) -> None:
        self.search = search
        self._folders = folders
        self._distro = distro
        self._modules: dict[tuple[str, str], dict[str, list[RosName]]] = {}
        self._lock = threading.RLock()
        self._digests: dict[str, str] = {}
        self._registry: InterfaceRegistry | None = None
        self._sources: ModuleSources | None = None

    def kinds(self, package: str) -> set[str]:
        """Return the kinds (msg, srv, action) of the interfaces in a package."""
        found = self.search.packages.get(package)
        return {name.kind for name in found.files} if found else set()

    def modules(self, package: str, kind: str) -> dict[str, list[RosName]]:
        """Return the module names of a package's interfaces of one kind, each with its interfaces.

        A module has two interfaces if both of their names give the same module name.
        """
        if (package, kind) not in self._modules:
            found: dict[str, list[RosName]] = {}
            for name in self.search.packages[package].files:
                if name.kind == kind:
                    found.setdefault(name.module_name, []).append(name)
            self._modules[package, kind] = found
        return self._modules[package, kind]

    def classes(self, package: str, kind: str) -> dict[str, str]:
        """Return the names of a package's classes of one kind (msg, srv, action), each with the module that
        defines it.
        """
        return {
            py_name(name.name + part): module
            for module, names in self.modules(package, kind).items()
            for name in names
            for part in _SUFFIXES[kind]
        }

    def fill(self, module: ModuleType, name: RosName, code: CodeType | None) -> None:
        """Define the classes of an interface in its module, by executing compiled `code`, or as native classes if
        `code` is None.

        Raises:
            DefinitionError: the definition has errors.
            TypeNotFoundError: its file was removed after the search.
        """
        if code is not None:
            exec(code, module.__dict__)
            return
        search = ClassSearch(self._folders, self._distro)
        for part in _SUFFIXES[name.kind]:
            cls = search.get(f"{name}{part}")
            module.__dict__[py_name(name.name + part)] = cls
        module.__dict__["__all__"] = [py_name(name.name + part) for part in _SUFFIXES[name.kind]]

    def code(self, name: RosName) -> tuple[disk_cache.Parts, CodeType]:
        """Return the compiled code of an interface's module with rclpy's API, and the interfaces from which it was
        compiled.

        The code is cached on disk.

        Raises:
            DefinitionError: the definition has errors.
        """
        with self._lock:
            text_digest = self._digest(str(name))
            found = disk_cache.load_code(str(name), text_digest, self._digest)
            if found is None:
                found = self._compiled(name)
                disk_cache.store_code(str(name), text_digest, *found)
            return found

    def _digest(self, interface: str) -> str:
        if interface not in self._digests:
            file = self.search.file(RosName.parse(interface))
            try:
                content = f"{file.suffix}\n".encode() + file.read_bytes() if file is not None else b""
            except OSError:
                content = b""
            self._digests[interface] = disk_cache.digest(content) if content else ""
        return self._digests[interface]

    def _compiled(self, name: RosName) -> tuple[disk_cache.Parts, CodeType]:
        from rosidl_py_gen.compiler.codegen import ModuleSources
        from rosidl_py_gen.compiler.frontend import InterfaceRegistry

        if self._registry is None or self._sources is None:
            self._registry = InterfaceRegistry(self.search)
            self._sources = ModuleSources(self._registry, rclpy=True)
        registry = self._registry
        try:
            registry.read_checked(name)
        except BaseException:
            self._registry = None  # discard incomplete interfaces
            raise
        module, source = self._sources.module(name)
        owners = {registry.owner(RosName.parse(part)) for part in registry.all_hashes(str(name))}
        parts = {str(owner): self._digest(str(owner)) for owner in owners if owner is not None}
        return parts, compile(source, f"<{module}>", "exec")
