"""Results of tf2_geometry_msgs, one line for each call. Run under the real one and under ours."""

import json

import numpy as np
import tf2_geometry_msgs as tf
import tf2_ros
from geometry_msgs.msg import (
    Point32,
    PointStamped,
    PolygonStamped,
    Pose,
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    TransformStamped,
    Vector3Stamped,
    Wrench,
)

rng = np.random.default_rng(3)


def told(value):
    if hasattr(value, "get_fields_and_field_types"):
        return [type(value).__name__, *(told(getattr(value, name)) for name in value.get_fields_and_field_types())]
    return [told(one) for one in value] if isinstance(value, list | tuple | np.ndarray) else value


def filled(message):
    """Fill a message with random numbers; quaternions are rotations."""
    if isinstance(message, Quaternion):
        values = rng.normal(size=4)
        message.x, message.y, message.z, message.w = values / np.linalg.norm(values)
        return message
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if hasattr(value, "get_fields_and_field_types"):
            filled(value)
        elif kind == "string":
            setattr(message, name, f"frame{rng.integers(9)}")
        elif kind == "double[36]":
            setattr(message, name, rng.uniform(-1, 1, 36))
        elif kind.startswith("sequence"):
            setattr(message, name, [filled(Point32()) for _ in range(3)])
        else:
            setattr(
                message, name, float(rng.uniform(-5, 5)) if kind in ("double", "float") else int(rng.integers(1, 9))
            )
    return message


ASKED = {
    PointStamped: tf.do_transform_point,
    Vector3Stamped: tf.do_transform_vector3,
    PoseStamped: tf.do_transform_pose_stamped,
    PoseWithCovarianceStamped: tf.do_transform_pose_with_covariance_stamped,
    PolygonStamped: tf.do_transform_polygon_stamped,
}
for _ in range(3):
    for cls, function in ASKED.items():
        message, how = filled(cls()), filled(TransformStamped())
        if how.transform.rotation.w < 0.2:
            how.transform.rotation = Quaternion()
        made = function(message, how)
        print(json.dumps([told(message), told(how.header), told(made), made.header is how.header]))
        print(json.dumps(tf2_ros.TransformRegistration().get(cls) is function))
    print(json.dumps(told(tf.do_transform_pose(filled(Pose()), filled(TransformStamped())))))
    print(json.dumps(told(tf.transform_covariance(rng.uniform(-1, 1, 36), filled(TransformStamped())))))
nothing = TransformStamped()
nothing.transform.rotation.w, nothing.transform.translation.x = 0.0, 2.0
print(json.dumps(told(tf.do_transform_point(filled(PointStamped()), nothing))))
print(json.dumps(told(tf.do_transform_pose(Pose(orientation=Quaternion(w=0.0)), filled(TransformStamped())))))
for cls in (Vector3Stamped, PoseStamped, PointStamped):
    print(json.dumps(type(tf2_ros.convert(filled(cls()), cls)).__name__))
try:
    tf2_ros.TransformRegistration().get(Wrench)
except tf2_ros.TypeException as error:
    print(json.dumps(type(error).__name__))
