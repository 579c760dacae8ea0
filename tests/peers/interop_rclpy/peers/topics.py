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
        self.messages = []
        self.count = 0
        self.arrival_future = None
        self.peer = peer
        self.subscription = node.create_subscription(cls, topic, self.on_message, qos)

    def on_message(self, message):
        self.messages.append(message)
        if self.arrival_future is not None and len(self.messages) >= self.count and not self.arrival_future.done():
            self.arrival_future.set_result(None)

    async def take(self, count):
        self.count, self.arrival_future = count, self.peer.new_future()
        if len(self.messages) < count:
            await self.arrival_future
        taken = self.messages[:count]
        del self.messages[:count]
        return taken


def publisher(peer, topic, type, qos=None, node=""):
    node = peer.nodes.get(node, peer.node)
    peer.entities["publisher", topic] = node.create_publisher(messages.load(type), topic, profile(**(qos or {})))


def publish(peer, topic, messages_):
    made = peer.entities["publisher", topic]
    for values in messages_:
        made.publish(messages.build(made.msg_type, values))


def unpublish(peer, topic):
    made = peer.entities.pop(("publisher", topic))
    peer.owner("publishers", made).destroy_publisher(made)


def subscribe(peer, topic, type, qos=None, node=""):
    node = peer.nodes.get(node, peer.node)
    peer.entities["subscription", topic] = Received(peer, node, messages.load(type), topic, profile(**(qos or {})))


def unsubscribe(peer, topic):
    made = peer.entities.pop(("subscription", topic)).subscription
    peer.owner("subscriptions", made).destroy_subscription(made)


async def take(peer, topic, count=1):
    """Wait for enough messages, and return the oldest ones."""
    taken = await peer.entities["subscription", topic].take(count)
    return [messages.to_plain(message) for message in taken]


async def matched(peer, topic, count=1):
    """Wait until the publisher or subscription has enough counterparts; subscriptions of Humble only see them."""
    made = peer.entities.get(("publisher", topic)) or peer.entities["subscription", topic].subscription
    number = getattr(made, "get_subscription_count", None) or getattr(made, "get_publisher_count", None)
    await peer.until(lambda: (number() if number else peer.node.count_publishers(topic)) >= count)


async def matched_exactly(peer, topic, count):
    """Wait until the publisher has this number of subscriptions."""
    await peer.until(lambda: peer.entities["publisher", topic].get_subscription_count() == count)
