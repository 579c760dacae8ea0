"""Lifecycle nodes."""
# ruff: noqa
# fmt: off

import rclpy
from rclpy.lifecycle import *
from rclpy.lifecycle import TransitionCallbackReturn as R
from lifecycle_msgs.msg import State, Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from std_msgs.msg import String

rclpy.init()  # ours: a context manager, as in Kilted
seen = []


class Bad(LifecycleNode):
    def on_configure(self, state):
        seen.append(("configure", state))
        raise ValueError("x")

    def on_error(self, state):
        seen.append(("error", state))
        return R.SUCCESS


class Fails(LifecycleNode):
    def on_configure(self, state):
        return R.FAILURE


class Worse(LifecycleNode):
    def on_configure(self, state):
        return R.ERROR

    def on_error(self, state):
        return R.ERROR


class Nothing(LifecycleNode):
    def on_configure(self, state):
        pass


class Entity(SimpleManagedEntity):
    @SimpleManagedEntity.when_enabled(when_not_enabled=lambda: seen.append("not enabled"))
    def work(self, what):
        seen.append(what)

    @SimpleManagedEntity.when_enabled
    def rest(self):
        seen.append("rest")


n = LifecycleNode("n")
entity = Entity()
n.add_managed_entity(entity)
publisher = n.create_lifecycle_publisher(String, "out", 10)
n.trigger_activate()  # text
n.trigger_configure()
n._state_machine.current_state
n.trigger_configure()  # text
(entity.is_activated, entity.work("a"), entity.rest(), list(seen), seen.clear())
(publisher.is_activated, publisher.publish(5))
n.trigger_activate()
(entity.is_activated, entity.work("a"), entity.rest(), list(seen), seen.clear())
publisher.is_activated
publisher.publish(5)
n.trigger_deactivate()
n.trigger_cleanup()
n.trigger_shutdown()
n.trigger_shutdown()
n._state_machine.current_state
bad = Bad("bad")
(bad.trigger_configure(), bad._state_machine.current_state, list(seen), seen.clear())
fails = Fails("fails")
(fails.trigger_configure(), fails._state_machine.current_state)
worse = Worse("worse")
(worse.trigger_configure(), worse._state_machine.current_state)
worse.trigger_configure()  # text
worse.trigger_shutdown()
Nothing("nothing").trigger_configure()
n.add_managed_entity(5)
n.create_lifecycle_publisher(String, "b", 10, publisher_class=5)
n.destroy_lifecycle_publisher(publisher)
fails._state_machine.available_transitions
len(n._state_machine.transition_graph)
n._state_machine.transition_graph
n._state_machine.available_states
(R.SUCCESS.to_label(), int(R.ERROR), R.FAILURE)

asker = rclpy.create_node("asker")
served = LifecycleNode("served")
events = []
subscription = asker.create_subscription(TransitionEvent, "served/transition_event", lambda m: events.append((m.start_state, m.goal_state)), 10)
executor = rclpy.executors.SingleThreadedExecutor()
(executor.add_node(asker), executor.add_node(served))


def ask(srv_type, name, **fields):
    client = asker.create_client(srv_type, "served/" + name)
    assert client.wait_for_service(10)
    future = client.call_async(srv_type.Request(**fields))
    executor.spin_until_future_complete(future, 10)
    return future.result()



ask(GetState, "get_state")
ask(GetAvailableStates, "get_available_states")
ask(GetAvailableTransitions, "get_available_transitions")
[str(one) for one in ask(GetAvailableTransitions, "get_transition_graph").available_transitions]
ask(ChangeState, "change_state", transition=Transition(label="activate"))
ask(ChangeState, "change_state", transition=Transition(id=1))
ask(ChangeState, "change_state", transition=Transition(label="activate"))
ask(GetState, "get_state")
[executor.spin_once(0.2) for _ in range(10)][0]
events[-2:]
sorted(name for name, _ in served.get_service_names_and_types_by_node("served", "/") if "state" in name or "trans" in name)
silent = LifecycleNode("silent", enable_communication_interface=False)
silent.trigger_configure()
sorted(name for name, _ in silent.get_service_names_and_types_by_node("silent", "/"))
sorted(name for name, _ in silent.get_publisher_names_and_types_by_node("silent", "/"))
rclpy.shutdown()
