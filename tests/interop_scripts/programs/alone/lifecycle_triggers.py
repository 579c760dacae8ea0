"""A lifecycle node that its own program drives: transitions, a publisher that is silent, failures, errors."""

import rclpy
from rclpy.lifecycle import LifecycleNode, LifecycleState, Node, Publisher, State, TransitionCallbackReturn
from std_msgs.msg import String

print(Node is LifecycleNode, State is LifecycleState, Publisher.__name__)


class Lamp(LifecycleNode):
    def __init__(self):
        super().__init__("lamp")
        self.answers = {}
        self.pub = None

    def told(self, name, state):
        print(name, state.label, state.state_id)
        answer = self.answers.get(name, TransitionCallbackReturn.SUCCESS)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def on_configure(self, state):
        self.pub = self.create_lifecycle_publisher(String, "light", 10)
        return self.told("configure", state)

    def on_activate(self, state):
        self.told("activate", state)
        return super().on_activate(state)

    def on_deactivate(self, state):
        self.told("deactivate", state)
        return super().on_deactivate(state)

    def on_cleanup(self, state):
        self.destroy_publisher(self.pub)
        return self.told("cleanup", state)

    def on_shutdown(self, state):
        return self.told("shutdown", state)

    def on_error(self, state):
        return self.told("error", state)


def tell(what):
    try:
        print("->", what())
    except Exception as error:
        print(type(error).__name__, isinstance(error, RuntimeError))


rclpy.init()
node = Lamp()
got = []
listener = rclpy.create_node("listener")
listener.create_subscription(String, "light", lambda msg: got.append(msg.data), 10)
tell(node.trigger_activate)
tell(node.trigger_configure)
node.pub.publish(String(data="dark"))
tell(node.trigger_activate)
print(node.pub.is_activated)
while not node.pub.get_subscription_count():
    rclpy.spin_once(listener, timeout_sec=0.05)
node.pub.publish(String(data="bright"))
while not got:
    rclpy.spin_once(listener, timeout_sec=0.1)
print(got)
tell(node.trigger_deactivate)
print(node.pub.is_activated)
tell(node.trigger_cleanup)
node.answers["configure"] = TransitionCallbackReturn.FAILURE
tell(node.trigger_configure)
node.answers["configure"] = ValueError("broken")
tell(node.trigger_configure)
node.answers["configure"] = TransitionCallbackReturn.ERROR
node.answers["error"] = TransitionCallbackReturn.ERROR
tell(node.trigger_configure)
tell(node.trigger_configure)
tell(node.trigger_shutdown)
print(TransitionCallbackReturn.SUCCESS.name, int(TransitionCallbackReturn.FAILURE.value))
node.destroy_node()
listener.destroy_node()
rclpy.shutdown()
