"""Server of results of tf2's buffer, of Debian's python3-tf2: one JSON request per line. Run by the system's Python."""

import json
import sys

import rospy
import tf2_py
from geometry_msgs.msg import TransformStamped


def time(nanoseconds):
    return rospy.Time(*divmod(nanoseconds, 10**9))


def insert(buffer, child, stamp, parent, translation, rotation, static):
    message = TransformStamped()
    message.header.frame_id, message.header.stamp, message.child_frame_id = parent, time(stamp), child
    move, turn = message.transform.translation, message.transform.rotation
    move.x, move.y, move.z = translation
    turn.x, turn.y, turn.z, turn.w = rotation
    (buffer.set_transform_static if static else buffer.set_transform)(message, "test")


def answer(buffer, request):
    what, *arguments = request
    if what == "insert":
        return insert(buffer, *arguments)
    try:
        if what == "lookup":
            target, source, at = arguments
            found = buffer.lookup_transform_core(target, source, time(at))
        else:
            target, target_time, source, source_time, fixed = arguments
            found = buffer.lookup_transform_full_core(target, time(target_time), source, time(source_time), fixed)
    except tf2_py.TransformException as error:
        return type(error).__name__
    move, turn = found.transform.translation, found.transform.rotation
    return [found.header.stamp.to_nsec(), [move.x, move.y, move.z], [turn.x, turn.y, turn.z, turn.w]]


for line in sys.stdin:
    requests = json.loads(line)
    core = tf2_py.BufferCore(rospy.Duration(10))
    sys.stdout.write(json.dumps([answer(core, request) for request in requests]) + "\n")
    sys.stdout.flush()
