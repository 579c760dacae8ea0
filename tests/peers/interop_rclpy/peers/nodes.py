"""Commands about nodes: parameters, the graph, logging, time, lifecycle, introspection."""

import resource

import messages
import rclpy
from rclpy.client import Client
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import qos_profile_system_default
from rclpy.service_introspection import ServiceIntrospectionState


def add_node(peer, name, namespace="", parameters=None, **options):
    overrides = [Parameter(key, value=value) for key, value in (parameters or {}).items()]
    peer.add_node(rclpy.create_node(name, namespace=namespace, parameter_overrides=overrides, **options))


def remove_node(peer, name):
    node = peer.nodes.pop(name)
    peer.executor.remove_node(node)
    node.destroy_node()


def clear(peer):
    """Destroy all entities except the node of the peer; actions stay, because goals may still be executed."""
    for name in [name for name, node in peer.nodes.items() if node is not peer.node]:
        remove_node(peer, name)
    for kind, name in list(peer.entities):
        if kind == "subscription":
            peer.node.destroy_subscription(peer.entities.pop((kind, name)).subscription)
        elif kind in ("publisher", "service", "client"):
            getattr(peer.node, f"destroy_{kind}")(peer.entities.pop((kind, name)))
        elif kind == "slow":
            executor, node, thread = peer.entities.pop((kind, name))
            executor.shutdown()
            thread.join()
            node.destroy_node()


def declare(peer, parameters, node=""):
    for name, value in parameters.items():
        peer.nodes.get(node, peer.node).declare_parameter(name, value)


def parameters(peer, names, node=""):
    found = peer.nodes.get(node, peer.node).get_parameters(names)
    return [list(one.value) if isinstance(one.value, bytes) else messages.to_plain(one.value) for one in found]


async def remote(peer, node, method, argument):
    """Call a method of rclpy's client for the parameters of another node; return the response."""
    made = AsyncParameterClient(peer.node, node)
    await peer.until(made.services_are_ready)
    if method.startswith("set_"):
        argument = [Parameter(name, value=value) for name, value in argument.items()]
    response = await getattr(made, method)(argument)
    for one in list(vars(made).values()):
        if isinstance(one, Client):
            peer.node.destroy_client(one)
    return messages.to_plain(response)


async def until_node(peer, name, there=True):
    await peer.until(lambda: (name in peer.node.get_fully_qualified_node_names()) == there)


async def until_by_node(peer, what, name, thing, there=True):
    """Wait until a node in the root namespace has an entity, or does not, and return its types.

    `what`: publisher, subscriber, service or client.
    """

    def found():
        return dict(getattr(peer.node, f"get_{what}_names_and_types_by_node")(name, "/"))

    await peer.until(lambda: (thing in found()) == there)
    return found().get(thing)


def names_and_types(peer, what):
    return dict(getattr(peer.node, f"get_{what}_names_and_types")())


def counts(peer, topic):
    return [peer.node.count_publishers(topic), peer.node.count_subscribers(topic)]


async def until_subscribed(peer, topic, count=1):
    await peer.until(lambda: peer.node.count_subscribers(topic) >= count)


def service_counts(peer, name):
    return [peer.node.count_services(name), peer.node.count_clients(name)]


async def until_infos(peer, topic, what, nodes):
    """Wait until the endpoints of a topic belong to these nodes, and return all about them."""

    def look():
        return getattr(peer.node, f"get_{what}_info_by_topic")(topic)

    await peer.until(lambda: [f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in look()] == nodes)
    found = look()
    return [
        {
            "node": f"{one.node_namespace.rstrip('/')}/{one.node_name}",
            "type": one.topic_type,
            "hash": str(one.topic_type_hash),
            "kind": one.endpoint_type.name,
            "gid": list(one.endpoint_gid),
            **{name: getattr(one.qos_profile, name).name for name in ("reliability", "durability", "liveliness")},
            **{
                name: getattr(one.qos_profile, name).nanoseconds
                for name in ("lifespan", "deadline", "liveliness_lease_duration")
            },
        }
        for one in found
    ]


def log(peer, text):
    """Log once with every level; rclpy requires a line of its own for each level."""
    logger = peer.node.get_logger()
    logger.info(text)
    logger.warning(text)
    logger.error(text)
    logger.fatal(text)


def logger_level(peer, name):
    return rclpy.logging.get_logger_effective_level(name).name


async def now_ns(peer, node, at_least):
    clock = peer.nodes[node].get_clock()
    await peer.until(lambda: clock.now().nanoseconds >= at_least)
    return clock.now().nanoseconds


def introspect(peer, kind, name, state):
    peer.entities[kind, name].configure_introspection(
        peer.node.get_clock(), qos_profile_system_default, getattr(ServiceIntrospectionState, state)
    )


class Lifecycle(LifecycleNode):
    """Node that records its transitions; activation fails if `fail` is set."""

    def __init__(self, name):
        super().__init__(name)
        self.declare_parameter("fail", False)
        self.done = []

    def on_configure(self, state):
        self.done.append("configure")
        return super().on_configure(state)

    def on_activate(self, state):
        self.done.append("activate")
        if self.get_parameter("fail").value:
            return TransitionCallbackReturn.FAILURE
        return super().on_activate(state)

    def on_shutdown(self, state):
        self.done.append("shutdown")
        return super().on_shutdown(state)


def lifecycle_node(peer, name):
    peer.add_node(Lifecycle(name))


def transitions(peer, name):
    return peer.nodes[name].done


def memory_mb(peer):
    """Return the most that the process has used."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
