"""The types of a node's surroundings: the classes of topics, services and actions, and how others define their types.

Decides the methods and their names; how a class is found is in `runtime.types.from_peers`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.cdr import Action, Message, Service
from rosidl_py_gen.runtime.loop.blocking import blocking
from rosidl_py_gen.runtime.names.validation import resolve_node_name
from rosidl_py_gen.runtime.type_resolution.announcements import action_subject, service_subject, topic_subject
from rosidl_py_gen.runtime.type_resolution.description_client import (
    announced_hash,
    decode_description,
    request_type_description,
)
from rosidl_py_gen.runtime.type_resolution.type_resolver import ResolveRequest, resolve

if TYPE_CHECKING:
    from rosidl_py_gen.msgs.type_description_interfaces.srv import GetTypeDescription_Response
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names.remapping import NodeNames
    from rosidl_py_gen.type_loading.class_lookup import SearchFolders


class TypeMethods:
    """Type methods of `Node`. Each one raises `ClosedError` when the node is closed."""

    _scope: EntityScope
    _names: NodeNames

    if TYPE_CHECKING:

        def _require_open(self) -> None: ...

    async def resolve_type(
        self,
        topic: str,
        type_name: str | None = None,
        *,
        type_hash: str | None = None,
        path: SearchFolders = (),
        timeout_s: float | None = None,
    ) -> type[Message]:
        """The class of what is published on a topic, wherever its definition is.

        Waits until a node announces the type. A class of the announced hash that is importable or on the search path is
        used; otherwise one of the nodes is asked for the definition, and its answer kept on disk. An answer of another
        hash than the announced one is refused. Nodes of ROS 2 Humble announce no hash: then the local definition of
        that name is used, with a warning.

        Args:
            type_name: needed when there are several types on the topic.
            type_hash: needed when there are several definitions of that type.
            path: folders with interfaces, looked through first, as by `get_message`.
            timeout_s: for all of it.

        Raises:
            TypeDescriptionError: several types or hashes; or nobody described the type as it was announced.
            TypeNotFoundError: no hash is announced, and there is no local definition.
            CallTimeoutError: nobody announces a type. InvalidNameError. DefinitionError: `path` cannot be read.
        """
        self._require_open()
        subject = topic_subject(self._names.resolve_topic(topic))
        request = ResolveRequest(subject, Message, type_name, type_hash, path)
        cls: type[Message] = await resolve(self._scope, self._names, request, timeout_s)
        return cls

    resolve_type_sync = blocking(resolve_type)

    async def resolve_service_type(
        self,
        service: str,
        type_name: str | None = None,
        *,
        type_hash: str | None = None,
        path: SearchFolders = (),
        timeout_s: float | None = None,
    ) -> type[Service[Any, Any]]:
        """The class of a service, as `resolve_type` that of a topic.

        Nodes announce the hashes of request and response, which decide whether a local definition is the right one.
        Nodes of this package describe both; those of ROS 2 only the whole service, whose hash none announces: give it
        as `type_hash`, or switch introspection on in the node.
        """
        self._require_open()
        subject = service_subject(self._names.resolve_service(service))
        request = ResolveRequest(subject, Service, type_name, type_hash, path)
        cls: type[Service[Any, Any]] = await resolve(self._scope, self._names, request, timeout_s)
        return cls

    resolve_service_type_sync = blocking(resolve_service_type)

    async def resolve_action_type(
        self,
        action: str,
        type_name: str | None = None,
        *,
        type_hash: str | None = None,
        path: SearchFolders = (),
        timeout_s: float | None = None,
    ) -> type[Action[Any, Any, Any]]:
        """The class of an action; see `resolve_service_type`, whose limits it shares."""
        self._require_open()
        from rosidl_py_gen.runtime.actions.types import ActionNames

        names = ActionNames.resolve(self._names, action)
        subject = action_subject(names.action, names.send_goal, names.get_result, names.feedback)
        request = ResolveRequest(subject, Action, type_name, type_hash, path)
        cls: type[Action[Any, Any, Any]] = await resolve(self._scope, self._names, request, timeout_s)
        return cls

    resolve_action_type_sync = blocking(resolve_action_type)

    async def get_type_description(
        self,
        remote_node: str,
        type_name: str,
        type_hash: str | None = None,
        *,
        include_type_sources: bool = True,
        timeout_s: float | None = None,
    ) -> GetTypeDescription_Response:
        """Ask another node how one of its types is defined.

        Args:
            type_name: of an endpoint: ``pkg/msg/Name``, ``pkg/srv/Name_Request``, ``pkg/action/Name_FeedbackMessage``.
                With a hash, which alone decides then, anything.
            type_hash: None takes the one that the node announces for its endpoints of that type. Whole services and
                actions are not announced; they need theirs.

        Raises:
            TypeDescriptionError: the node's own reason; or it announces no hash for that type, or several.
            CallTimeoutError, InvalidNameError: as their names say.
        """
        node = resolve_node_name(remote_node, self._names.namespace)
        service = self._names.resolve_service(f"{node}/get_type_description")
        if type_hash is None:
            type_hash, timeout_s = await announced_hash(self._scope, node, type_name, timeout_s)
        answer = await request_type_description(
            self._scope, service, type_name, type_hash, include_type_sources, timeout_s
        )
        return decode_description(service, answer)

    get_type_description_sync = blocking(get_type_description)
