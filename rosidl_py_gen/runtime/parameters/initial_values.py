"""The initial values that one context has for its nodes, and what is said of those that nobody takes.

A mistyped name in ``-p``, in a file or in `overrides` would otherwise do nothing, as in ROS, and nobody would know.
Decides when that is said: when a peer asks for the list of a node's parameters, as ``param list`` does, and at the
latest when the last node closes that a value was for. What is given to several nodes needs one that takes it, and
lifecycle nodes have time until they are configured. Each value is warned about once.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.runtime.logs.loggers import get_root_logger
from rosidl_py_gen.runtime.parameters.overrides import ParameterOverrides

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.parameters.store import ParameterStore
    from rosidl_py_gen.runtime.parameters.values import ParameterValue


@dataclass(slots=True, eq=False)
class _OverrideSource:
    """One `-p`, the part of a file for one pattern, or what one node was constructed with."""

    parameters: ParameterOverrides
    only: ParameterStore | None = None
    left: dict[str, ParameterValue] = field(default_factory=dict)
    """What was neither taken nor warned about."""
    is_for_somebody: bool = False

    def concerns(self, holder: _OpenNode) -> bool:
        is_for = holder.takes_global if self.only is None else self.only is holder.store
        return is_for and self.parameters.matches(holder.scope.node_name)


@dataclass(slots=True, eq=False)
class _OpenNode:
    """A node that is open, as something that its scope closes."""

    scope: EntityScope
    store: ParameterStore
    may_declare_more: Callable[[], bool]
    leave: Callable[[_OpenNode], None]
    takes_global: bool
    """What is given to no node in particular is for it, too."""

    def close(self) -> None:
        self.leave(self)


class InitialValues:
    """The initial values that files and arguments give the nodes of one context."""

    def __init__(self, parameters: Sequence[ParameterOverrides]) -> None:
        self._given = [_OverrideSource(one, left=dict(one.values)) for one in parameters]
        self._holders: list[_OpenNode] = []
        self._seen: list[str] = []
        """Names of all nodes that ever were."""

    def opened(
        self,
        scope: EntityScope,
        store: ParameterStore,
        own: Mapping[str, ParameterValue],
        arguments: Sequence[ParameterOverrides],
        may_declare_more: Callable[[], bool],
        *,
        takes_global: bool,
    ) -> None:
        """A node begins to declare; `own` and `arguments` are what its constructor got."""
        if not self._given and not own and not arguments:
            return
        holder = _OpenNode(scope, store, may_declare_more, self._closed, takes_global)
        self._given += [_OverrideSource(one, store, dict(one.values)) for one in arguments]
        if own:
            constructor = ParameterOverrides(scope.node_name, own, "parameter_overrides=")
            self._given.append(_OverrideSource(constructor, store, dict(own)))
        self._holders.append(holder)
        self._seen.append(scope.node_name)
        scope.register(holder)

    def close(self) -> None:
        """The context ends; all its nodes have closed."""
        if self._seen:
            self._warn_unmatched_nodes()

    # ----------------------------------------------------------------------------------------------------- the moment

    def on_listed(self, store: ParameterStore) -> None:
        """A peer has asked for the list of a node's parameters: warn of what none of them took."""
        for given in list(self._given):
            holders = [one for one in self._holders if given.concerns(one)]
            self._discard_used(given, holders)
            if any(one.store is store for one in holders) and not any(one.may_declare_more() for one in holders):
                self._warn(given, holders)

    def _closed(self, holder: _OpenNode) -> None:
        for given in list(self._given):
            holders = [one for one in self._holders if given.concerns(one)]
            self._discard_used(given, holders)
            if holders and holder.store.sources.was_refused:
                given.left.clear()
            elif holders == [holder]:
                self._warn(given, holders)
        self._holders.remove(holder)

    def _discard_used(self, given: _OverrideSource, holders: list[_OpenNode]) -> None:
        given.is_for_somebody |= bool(holders)
        for holder in holders:
            for name in holder.store.taken & given.left.keys():
                del given.left[name]

    # ------------------------------------------------------------------------------------------------------ the words

    def _warn(self, given: _OverrideSource, holders: list[_OpenNode]) -> None:
        nodes = ", ".join(one.scope.node_name for one in holders)
        declared = [name for one in holders for name in one.store.values()]
        for name, value in given.left.items():
            why = "which declares none of that name" if len(holders) == 1 else "which declare none of that name"
            if name in declared:
                why = "which ignores initial values for it"
            holders[0].scope.logger.warning(
                f"{given.parameters.source} gives the parameter {name} = {value.value!r:.100} to {nodes}, {why}"
                f"{did_you_mean(name, [one for one in declared if one != name])}"
            )
        given.left.clear()

    def _warn_unmatched_nodes(self) -> None:
        """Warn of files and arguments that are for nodes which never were here."""
        by_source: dict[str, list[_OverrideSource]] = {}
        for given in self._given:
            given.is_for_somebody = given.is_for_somebody or any(given.concerns(one) for one in self._holders)
            by_source.setdefault(given.parameters.source, []).append(given)
        for source, parts in by_source.items():
            if any(one.is_for_somebody or not one.left for one in parts):
                continue
            wanted = ", ".join(dict.fromkeys(one.parameters.pattern for one in parts))
            get_root_logger().warning(
                f"{source} has parameters for {wanted}, and no node of that name is here"
                f"{did_you_mean(wanted, self._seen)}"
            )
            for one in parts:
                one.left.clear()
