"""Commands about topics."""

import messages
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

POLICIES = {
    "history": HistoryPolicy,
    "reliability": ReliabilityPolicy,
    "durability": DurabilityPolicy,
    "liveliness": LivelinessPolicy,
}


DURATIONS = {"deadline_s": "deadline", "lifespan_s": "lifespan", "lease_s": "liveliness_lease_duration"}


def profile(depth=10, **policies):
    made = QoSProfile(depth=depth)
    for name, value in policies.items():
        if name in DURATIONS:
            setattr(made, DURATIONS[name], Duration(seconds=value))
        else:
            setattr(made, name, POLICIES[name][value])
    return made


class Received:
    """Subscription with the received messages that were not taken yet."""

    def __init__(self, peer, node, cls, topic, qos):
        self.kept = []
        self.wanted = 0
        self.enough = None
        self.peer = peer
        self.subscription = node.create_subscription(cls, topic, self.arrived, qos)

    def arrived(self, message):
        self.kept.append(message)
        if self.enough is not None and len(self.kept) >= self.wanted and not self.enough.done():
            self.enough.set_result(None)

    async def take(self, count):
        self.wanted, self.enough = count, self.peer.new_future()
        if len(self.kept) < count:
            await self.enough
        taken = self.kept[:count]
        del self.kept[:count]
        return taken


def publisher(peer, topic, type, qos=None, node=""):
    node = peer.nodes.get(node, peer.node)
    peer.things["publisher", topic] = node.create_publisher(messages.load(type), topic, profile(**(qos or {})))


def publish(peer, topic, messages_):
    made = peer.things["publisher", topic]
    for values in messages_:
        made.publish(messages.build(made.msg_type, values))


def unpublish(peer, topic):
    made = peer.things.pop(("publisher", topic))
    peer.owner("publishers", made).destroy_publisher(made)


def subscribe(peer, topic, type, qos=None, node=""):
    node = peer.nodes.get(node, peer.node)
    peer.things["subscription", topic] = Received(peer, node, messages.load(type), topic, profile(**(qos or {})))


def unsubscribe(peer, topic):
    made = peer.things.pop(("subscription", topic)).subscription
    peer.owner("subscriptions", made).destroy_subscription(made)


async def take(peer, topic, count=1):
    """Wait for enough messages, and return the oldest ones."""
    taken = await peer.things["subscription", topic].take(count)
    return [messages.to_plain(message) for message in taken]


async def matched(peer, topic, count=1):
    """Wait until the publisher or subscription has enough counterparts."""
    made = peer.things.get(("publisher", topic)) or peer.things["subscription", topic].subscription
    number = made.get_subscription_count if hasattr(made, "get_subscription_count") else made.get_publisher_count
    await peer.until(lambda: number() >= count)
