"""From checked definitions to Python source: layout -> plan -> view -> templates."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.generated_files import GENERATED_HEADER
from rosidl_py_gen.compiler.codegen.layout_planner import LayoutPlanner
from rosidl_py_gen.compiler.codegen.render import render_alias, render_kind, render_module, render_package
from rosidl_py_gen.compiler.codegen.template_model import (
    Target,
    alias_view,
    exported_names,
    kind_view,
    module_name,
    module_path,
    module_view,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry


def module_source(library: InterfaceRegistry, name: RosName, layouts: LayoutPlanner, target: Target) -> str:
    """The source of one interface's module. The interface and everything it refers to must exist and be right."""
    interface = library.interface(name)
    assert interface is not None, name
    origin = target.known(str(name))
    if origin is not None:
        return render_alias(alias_view(interface, origin))
    return render_module(module_view(interface, layouts, target))


def package_sources(
    library: InterfaceRegistry,
    names: Iterable[RosName],
    target: Target,
    progress: Callable[[RosName], object] = lambda name: None,
) -> dict[str, str]:
    """Every file of the packages the names belong to: relative path -> text, in path order.

    Args:
        library: knows all names and everything they refer to.
        names: the interfaces to print.
        target: import prefix and known classes.
        progress: called before each module.
    """
    layouts = LayoutPlanner(library.message)
    files: dict[str, str] = {}
    kinds: dict[tuple[str, str], list[tuple[RosName, tuple[str, ...]]]] = {}
    for name in names:
        progress(name)
        files[f"{name.package}/{name.kind}/{module_name(name.name)}.py"] = module_source(library, name, layouts, target)
        interface = library.interface(name)
        assert interface is not None
        kinds.setdefault((name.package, name.kind), []).append((name, exported_names(interface)))
    for (package, kind), interfaces in kinds.items():
        files[f"{package}/{kind}/__init__.py"] = render_kind(kind_view(target.root, package, kind, interfaces))
        files[f"{package}/__init__.py"] = render_package(package)
        files[f"{package}/py.typed"] = f"{GENERATED_HEADER}: the package is typed (PEP 561). Do not edit.\n"
    return dict(sorted(files.items()))


__all__ = [
    "GENERATED_HEADER",
    "LayoutPlanner",
    "Target",
    "module_name",
    "module_path",
    "module_source",
    "package_sources",
]
