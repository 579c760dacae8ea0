"""From checked definitions to Python source: layout plan, encoder and decoder, template."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.generated_files import GENERATED_HEADER
from rosidl_py_gen.compiler.codegen.layout_planner import LayoutPlanner
from rosidl_py_gen.compiler.codegen.naming import sort_key
from rosidl_py_gen.compiler.codegen.render import render
from rosidl_py_gen.compiler.codegen.template_model import Target, exported_names, module_name, module_view

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry


def module_source(registry: InterfaceRegistry, name: RosName, planner: LayoutPlanner, target: Target) -> str:
    """Return the source of an interface's module; the interface and all types that it refers to must be valid."""
    interface = registry.interface(name)
    assert interface is not None, name
    origin = target.known(str(name))
    if origin is None:
        return render("module.py.jinja", module=module_view(interface, planner, target))
    names = sorted(exported_names(interface), key=sort_key)
    return render("alias.py.jinja", ros_name=str(name), origin=origin, names=names)


def package_sources(
    registry: InterfaceRegistry,
    names: Iterable[RosName],
    target: Target,
    progress: Callable[[RosName], object] = lambda name: None,
) -> dict[str, str]:
    """Return the files of the packages of some interfaces: relative path -> text, in path order.

    Args:
        registry: contains the interfaces and all types that they refer to.
        names: the interfaces.
        target: import prefix and existing classes.
        progress: called before each module.
    """
    planner = LayoutPlanner(registry.message)
    files: dict[str, str] = {}
    exports: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for name in names:
        progress(name)
        module = module_name(name.name)
        files[f"{name.package}/{name.kind}/{module}.py"] = module_source(registry, name, planner, target)
        interface = registry.interface(name)
        assert interface is not None
        classes = exports.setdefault((name.package, name.kind), [])
        classes += [(cls, module) for cls in exported_names(interface)]
    for (package, kind), classes in exports.items():
        files[f"{package}/{kind}/__init__.py"] = render(
            "kind_init.py.jinja",
            root=target.root,
            package=package,
            kind=kind,
            exports=sorted(classes, key=lambda row: (sort_key(row[1]), sort_key(row[0]))),
            names=sorted((cls for cls, _ in classes), key=sort_key),
        )
        files[f"{package}/__init__.py"] = render("package_init.py.jinja", package=package)
        files[f"{package}/py.typed"] = f"{GENERATED_HEADER}: the package is typed (PEP 561). Do not edit.\n"
    return dict(sorted(files.items()))
