"""Type methods of a node: classes of other nodes' topics, services and actions, and their type descriptions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen.base.waiters import blocking
from rosidl_py_gen.cdr import Action, Message, Service
from rosidl_py_gen.runtime.names.validation import resolve_node_name
from rosidl_py_gen.runtime.node.node_base import NodeBase
from rosidl_py_gen.runtime.type_resolution.announcements import action_query, service_query, topic_query
from rosidl_py_gen.runtime.type_resolution.description_service import (
    announced_hash,
    decode_description,
    request_type_description,
)
from rosidl_py_gen.runtime.type_resolution.type_resolver import TypeResolver

if TYPE_CHECKING:
    from rosidl_py_gen.msgs.type_description_interfaces.srv import GetTypeDescription_Response
    from rosidl_py_gen.runtime.type_resolution.announcements import TypeQuery
    from rosidl_py_gen.type_loading.class_lookup import SearchFolders

BaseT = TypeVar("BaseT")


class TypeMethods(NodeBase):
    """Type methods of `Node`. Each one raises `ClosedError` when the node is closed."""

    async def resolve_type(
        self,
        topic: str,
        type_name: str | None = None,
        *,
        type_hash: str | None = None,
        path: SearchFolders = (),
        timeout_s: float | None = None,
    ) -> type[Message]:
        """Return the message class of a topic, from a local definition or the description by another node.

        Waits until a node announces the type. A class of the announced hash that is importable or on the search path is
        used; otherwise one of the nodes is asked for the definition, and its description is cached on disk.
        Descriptions with another hash than the announced one are refused. Nodes of ROS 2 Humble announce no hash: then
        the local definition of that name is used, with a warning.

        Args:
            topic: topic name, which is expanded and remapped.
            type_name: required if the topic has several types.
            type_hash: required if there are several definitions of that type.
            path: folders with interfaces, searched first, as by `get_message`.
            timeout_s: time limit of the whole search; None waits forever.

        Raises:
            TypeDescriptionError: there are several types or hashes, or no node described the announced type.
            TypeNotFoundError: no hash is announced, and there is no local definition.
            CallTimeoutError: no node announced a type within `timeout_s`.
            InvalidNameError: topic or type name is invalid.
            DefinitionError: `path` cannot be read.
        """
        return await self._resolve(
            topic_query(self._names.resolve_topic(topic)), Message, type_name, type_hash, path, timeout_s
        )

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
        """Return the class of a service, like `resolve_type`.

        Nodes announce the hashes of request and response, with which a local definition is compared. Nodes of this
        package describe both. Nodes of ROS 2 describe only the whole service, whose hash is not announced: pass it as
        `type_hash`, or switch introspection on in the node.

        Raises:
            TypeDescriptionError: there are several types or hashes, or no node described the announced type.
            TypeNotFoundError: no hash is announced, and there is no local definition.
            CallTimeoutError: no node announced a type within `timeout_s`.
            InvalidNameError: name or type name is invalid.
            DefinitionError: `path` cannot be read.
        """
        return await self._resolve(
            service_query(self._names.resolve_service(service)), Service, type_name, type_hash, path, timeout_s
        )

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
        """Return the class of an action, like `resolve_service_type`, with the same restrictions.

        Raises:
            TypeDescriptionError: there are several types or hashes, or no node described the announced type.
            TypeNotFoundError: no hash is announced, and there is no local definition.
            CallTimeoutError: no node announced a type within `timeout_s`.
            InvalidNameError: name or type name is invalid.
            DefinitionError: `path` cannot be read.
        """
        from rosidl_py_gen.runtime.actions.types import ActionNames

        names = ActionNames.resolve(self._names, action)
        query = action_query(names.action, names.send_goal, names.get_result, names.feedback)
        return await self._resolve(query, Action, type_name, type_hash, path, timeout_s)

    resolve_action_type_sync = blocking(resolve_action_type)

    async def _resolve(
        self,
        query: TypeQuery,
        base: type[BaseT],
        type_name: str | None,
        type_hash: str | None,
        path: SearchFolders,
        timeout_s: float | None,
    ) -> type[BaseT]:
        self._require_open()
        resolver = TypeResolver(self._scope, self._names, query, base, type_name, type_hash, path, timeout_s)
        cls: type[BaseT] = await resolver.run()
        return cls

    async def get_type_description(
        self,
        remote_node: str,
        type_name: str,
        type_hash: str | None = None,
        *,
        include_type_sources: bool = True,
        timeout_s: float | None = None,
    ) -> GetTypeDescription_Response:
        """Request the definition of a type from another node.

        Args:
            remote_node: name of the node, in this node's namespace or fully qualified.
            type_name: message type of an endpoint: ``pkg/msg/Name``, ``pkg/srv/Name_Request``,
                ``pkg/action/Name_FeedbackMessage``. Not used if `type_hash` is given.
            type_hash: None uses the hash that the node announces for endpoints of that type. The hashes of whole
                services and actions are not announced.
            include_type_sources: request the definition files, too.
            timeout_s: None waits forever.

        Raises:
            TypeDescriptionError: the node reports an error, or announces no hash for the type, or several.
            CallTimeoutError: the node or its service did not appear, or did not reply, within `timeout_s`.
            InvalidNameError: node or type name is invalid.
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
