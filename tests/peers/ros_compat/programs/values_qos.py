"""Quality of service."""
# ruff: noqa
# fmt: off

from rclpy.duration import Duration
from rclpy.qos import *
from rclpy.qos import QoSCompatibility

QoSProfile()
QoSProfile(depth=-1)
QoSProfile(depth=1.0)  # text
QoSProfile(history=1)
QoSProfile(history=9,depth=1)
QoSProfile(history="a",depth=1)  # text
QoSProfile(depth=0)
QoSProfile(history=QoSHistoryPolicy.KEEP_ALL)
str(QoSProfile(history=QoSHistoryPolicy.KEEP_ALL))
QoSProfile(depth=1,foo=2)
QoSProfile(5)
QoSProfile(depth=1,deadline=5)  # text
str(QoSProfile(depth=1,reliability=QoSReliabilityPolicy.BEST_EFFORT))
repr(QoSProfile(depth=1))
hash(QoSProfile(depth=1))
QoSProfile(depth=True)
QoSProfile(depth=1,avoid_ros_namespace_conventions=1)  # text
[(k,v.value) for k,v in QoSPresetProfiles.__members__.items()][0]
list(QoSPresetProfiles.__members__)  # ours: with the one of Lyrical
QoSPresetProfiles.short_keys()  # ours: with the one of Lyrical
QoSPresetProfiles.get_from_short_key("sensor_data")
QoSCompatibility.OK.name
int(QoSCompatibility.ERROR)
QoSCompatibility(1)
list(QoSPolicyKind)
qos_policy_name_from_kind(3)
qos_policy_name_from_kind(8)
qos_check_compatible(QoSProfile(depth=1,reliability=2),QoSProfile(depth=1))
qos_check_compatible(qos_profile_system_default,qos_profile_system_default)
qos_check_compatible(qos_profile_unknown,QoSProfile(depth=1))
qos_check_compatible(QoSProfile(depth=1,deadline=Duration(seconds=2), durability=2,liveliness=1),QoSProfile(depth=1,deadline=Duration(seconds=1),durability=1,liveliness=3,liveliness_lease_duration=Duration(seconds=1)))
[qos_check_compatible(QoSProfile(depth=1,reliability=a),QoSProfile(depth=1,reliability=b)) for a in range(4) for b in range(4)]
[qos_check_compatible(QoSProfile(depth=1,durability=a),QoSProfile(depth=1,durability=b)) for a in range(4) for b in range(4)]
[qos_check_compatible(QoSProfile(depth=1,liveliness=a),QoSProfile(depth=1,liveliness=b)) for a in (0,1,3,4) for b in (0,1,3,4)]
[qos_check_compatible(QoSProfile(depth=1,deadline=Duration(seconds=a)),QoSProfile(depth=1,deadline=Duration(seconds=b))) for a in range(3) for b in range(3)]
[qos_check_compatible(QoSProfile(depth=1,liveliness=1,liveliness_lease_duration=Duration(seconds=a)),QoSProfile(depth=1,liveliness=1,liveliness_lease_duration=Duration(seconds=b))) for a in range(3) for b in range(3)]
qos_check_compatible(QoSProfile(depth=1,reliability=2,durability=2,liveliness=1),QoSProfile(depth=1,reliability=1,durability=1,liveliness=3,deadline=Duration(seconds=1),liveliness_lease_duration=Duration(seconds=1)))
qos_profile_best_available==QoSProfile(depth=10)
qos_check_compatible(QoSProfile(depth=1,deadline=Duration(seconds=-2)),QoSProfile(depth=1))  # ours: a negative period
list(LivelinessPolicy.__members__.items())
list(DurabilityPolicy.__members__.items())
list(ReliabilityPolicy.__members__.items())
list(HistoryPolicy.__members__.items())
DurabilityPolicy.short_keys()
DurabilityPolicy.get_from_short_key("volatile")
type(DurabilityPolicy.get_from_short_key("volatile"))
InvalidQoSProfileException("x","y")
str(InvalidQoSProfileException("x","y"))
DeadlineBestAvailable
LivelinessLeaseDurationeBestAvailable
QoSProfile(depth=1)==5
[str(preset.value) for preset in QoSPresetProfiles]  # ours: with the one of Lyrical
int(QoSCompatibility(2))
DurabilityPolicy.VOLATILE.short_key
LivelinessPolicy.RMW_QOS_POLICY_LIVELINESS_AUTOMATIC
QoSHistoryPolicy.RMW_QOS_POLICY_HISTORY_KEEP_ALL
LivelinessPolicy.RMW_QOS_POLICY_DURABILITY_UNKNOWN
str(QoSProfile(**QoSProfile(depth=7, deadline=Duration(seconds=1)).get_c_qos_profile().to_dict()))

import time
import rclpy
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherEventType, QoSSubscriptionEventType, SubscriptionEventCallbacks
from rclpy.qos import QoSPolicyKind, qos_policy_name_from_kind
from std_msgs.msg import String
QoSPublisherEventType.RCL_PUBLISHER_MATCHED
str(QoSSubscriptionEventType.RCL_SUBSCRIPTION_MATCHED)
(isinstance(QoSCompatibility.OK, int), QoSCompatibility.ERROR == 2, f"{QoSCompatibility.OK}")
rclpy.init()  # ours: a context manager, as in Kilted
n = rclpy.create_node("n")
told = {}
pub = n.create_publisher(String, "t", QoSProfile(depth=1), event_callbacks=PublisherEventCallbacks(incompatible_qos=lambda e: told.update(pub=e.last_policy_kind)))
sub = n.create_subscription(String, "t", print, QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL), event_callbacks=SubscriptionEventCallbacks(incompatible_qos=lambda e: told.update(sub=e.last_policy_kind)))
end = time.monotonic() + 20
while len(told) < 2 and time.monotonic() < end:
    rclpy.spin_once(n, timeout_sec=0.1)
sorted(told.items())
kind = told["sub"]
(str(kind), f"{kind}", isinstance(kind, int), int(kind), kind == QoSPolicyKind.DURABILITY, QoSPolicyKind.DURABILITY == kind, kind == 2, qos_policy_name_from_kind(kind), QoSPolicyKind(kind), {QoSPolicyKind.DURABILITY: 1}.get(kind))
[str(one.event_type) for one in pub.event_handlers]
rclpy.shutdown()
