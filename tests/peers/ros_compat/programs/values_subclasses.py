"""Names that public programs define in subclasses of nodes, as methods and as attributes."""
# ruff: noqa
# fmt: off

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Callable, List, Node, Optional
from rclpy.parameter import Parameter
from std_msgs.msg import String
from std_srvs.srv import Trigger

VERBS = "add build call check clear close compute configure connect count create declare destroy do execute find finish forget get handle init initialize is keep load log look make note on open parse process publish read refresh register remove reset resolve run send set setup shutdown spin start stop store take tell update validate wait wake watch write".split()
NOUNS = "action callback client clock command config connection context counter data entities events executor feedback future goal graph group handle image info interfaces joints lock logger message model name namespace node parameters params pose publisher publishers qos queue rate request result ros service services state status subscribers subscriptions tf thread timer timers topic topics transform values".split()
OURS = "apply ask_entities change_state count descriptors destroy destroy_entities ends_of_node entities events executor full_name group guards handle_of infos init_entities init_parameters keep logger node of_node open overrides overrides_of published queue rate_group ready refusal resolve_name resolved run_callback served start_parameter_services store tell values waitables what_is_served with_events".split()
names = {f"_{one}" for one in VERBS + NOUNS + OURS} | {f"_{verb}_{noun}" for verb in VERBS for noun in NOUNS} | {f"_on_{noun}" for noun in NOUNS} | {f"_{noun}_callback" for noun in NOUNS} | {f"_{noun}_lock" for noun in NOUNS} | {f"_is_{one}" for one in "active connected enabled initialized ready running shutdown".split()}
OF_RCLPY = {name for cls in (Node, LifecycleNode) for name in vars(cls)} | {"_parameters", "_publishers", "_subscriptions", "_clients", "_services", "_timers", "_guards", "_default_callback_group", "_rate_group", "_descriptors", "_clock", "_logger", "_context", "_allow_undeclared_parameters", "_parameter_overrides", "_time_source", "_parameter_service", "_type_description_service", "_parameter_event_publisher", "_callbacks", "_managed_entities", "_state_machine"}


def boom(self, *args, **kwargs):
    raise ValueError("called")


def use(cls):
    """Use all features of a node."""
    node = cls("used", parameter_overrides=[Parameter("o", value=3)])
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    got = []
    sub = node.create_subscription(String, "t", got.append, 10)
    pub = node.create_publisher(String, "t", 10)
    timer = node.create_timer(0.001, lambda: got.append("timer"))
    server = node.create_service(Trigger, "s", lambda request, response: response)
    client = node.create_client(Trigger, "s")
    node.declare_parameter("o", 1), node.set_parameters([Parameter("o", value=4)]), node.get_parameters(["o"]), node.undeclare_parameter("o")
    node.count_publishers("t"), node.get_publishers_info_by_topic("t"), node.get_node_names(), node.get_topic_names_and_types()
    node.resolve_topic_name("t"), node.get_publisher_names_and_types_by_node("used", "/")
    node.create_guard_condition(lambda: None).trigger()
    node.get_logger().debug("x"), node.get_clock().now()
    while "timer" not in got:
        executor.spin_once(timeout_sec=1)
    if isinstance(node, LifecycleNode):
        node.trigger_configure(), node.trigger_shutdown()
    node.destroy_timer(timer), node.destroy_publisher(pub)
    executor.shutdown()
    node.destroy_node()


def breaks(base, names):
    """Return the names that a subclass must not define; all at once, and one at a time only after a failure."""
    try:
        use(type("Sub", (base,), dict.fromkeys(names, boom)))
        return []
    except Exception:
        return [name for name in sorted(names) if fails(type("Sub", (base,), {name: boom}))]


def fails(cls):
    try:
        use(cls)
        return False
    except Exception:
        return True


class Instance(Node):
    """Attributes that are set after the creation."""

    def __init__(self, name, **options):
        super().__init__(name, **options)
        for one in names - OF_RCLPY:
            setattr(self, one, None)


rclpy.init()  # ours: a context manager, as in Kilted
len(names) > 2000
breaks(Node, names - OF_RCLPY)
breaks(LifecycleNode, names - OF_RCLPY)
fails(Instance)
type("Node", (Node,), {"__init__": lambda self, name, **options: (Node.__init__(self, name, **options), setattr(self, "_Node__logger", 1), setattr(self, "_Node__clock", 2), setattr(self, "_Node__services", 3), None)[-1]})("n").get_name()
[name for name in "declare_parameters get_parameters get_parameter list_parameters describe_parameters set_parameters_atomically get_namespace create_rate wait_for_node publishers reset spin run destroy shutdown start stop".split() if breaks(Node, [name])]
n = Node("n", parameter_overrides=[Parameter("o", value=3)])
sorted(name for name in vars(n) if not name.startswith(("_rosidl_", "rosidl_", "_Node__")))
n._logger is n.get_logger()
n._clock is n.get_clock()
n._context is n.context
(n._default_callback_group is n.default_callback_group, n._allow_undeclared_parameters)
{name: one.value for name, one in n._parameter_overrides.items()}
sorted(n._parameters)
n._parameters["use_sim_time"]
n._descriptors["use_sim_time"].read_only
timer = n.create_timer(10.0, None)
(n._timers == [timer], n._subscriptions, len(n._publishers) > 0, n._clients, n._guards, len(n._services) > 5)
(n._time_source.ros_time_is_active, n._time_source._clock_sub)
n._parameter_event_publisher.topic_name
(n._on_set_parameters_callbacks != [], n._pre_set_parameters_callbacks, n._post_set_parameters_callbacks)
n._on_set_parameters_callbacks.clear()
n._validate_qos_or_depth_parameter(5).depth
n._validate_topic_or_service_name("a b")
n._validate_topic_or_service_name("ok")
n._wake_executor()
n._allow_undeclared_parameters = True
n.get_parameter("undeclared")
n._default_callback_group = group = ReentrantCallbackGroup()
n.create_timer(10.0, None).callback_group is group
n._parameter_overrides = {"p": Parameter("p", value=7)}
n.declare_parameter("p", 1)
n._clock = clock = Clock()
(n.get_clock() is clock, n.create_timer(10.0, None).clock is clock)
n._timers = []
later = n.create_timer(10.0, None)
(n._timers == [later], n.destroy_timer(later), n._timers)
n._logger = logger = rclpy.logging.get_logger("mine")
n.get_logger() is logger
n._subscriptions = [n.create_subscription(String, f"t{number}", print, 10) for number in range(2)]
[one.topic for one in n._subscriptions]
n.destroy_node()
n._parameter_event_publisher
m = Node("m", allow_undeclared_parameters=True, enable_logger_service=True, start_parameter_services=False)
(m._allow_undeclared_parameters, hasattr(m, "_logger_service"), hasattr(m, "_parameter_service"))
l = LifecycleNode("l")
sorted(name for name in vars(l) if not name.startswith(("_rosidl_", "rosidl_", "_Node__", "_Lifecycle")) and name not in vars(m))
l._state_machine.current_state
l._managed_entities
rclpy.shutdown()
