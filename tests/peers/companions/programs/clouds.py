"""Results of sensor_msgs_py and tf2_sensor_msgs, one line for each call. Run under the real ones and under ours."""

import array
import json

import numpy as np
from geometry_msgs.msg import Transform, TransformStamped
from sensor_msgs.msg import PointCloud2, PointField
from sensor_msgs_py import point_cloud2
from std_msgs.msg import Header
from tf2_sensor_msgs import do_transform_cloud, transform_points

KINDS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


def field(name, offset, kind, count=1):
    return PointField(name=name, offset=offset, datatype=KINDS[kind], count=count)


def values(size):
    """Return bytes that are numbers of any type, without signalling NaN."""
    return np.random.default_rng(5).integers(0, 100, size, "u1")


def cloud(fields, step, width, height=1, big=False, dense=False, data=None):
    made = PointCloud2(header=Header(frame_id="a"), fields=fields, point_step=step, width=width, height=height)
    made.is_bigendian, made.is_dense, made.row_step = big, dense, step * width
    made.data = array.array("B", (values(step * width * height) if data is None else data).tobytes())
    return made


def shown(value):
    if isinstance(value, PointCloud2):
        fields = [(one.name, one.offset, one.datatype, one.count) for one in value.fields]
        head = value.header.frame_id, value.height, value.width, value.point_step, value.row_step
        return *head, bool(value.is_bigendian), bool(value.is_dense), fields, bytes(value.data).hex()
    if isinstance(value, np.ndarray):
        fields = value.dtype.fields or {"": (value.dtype, 0)}
        kinds = {name: (kind[0].str, kind[1]) for name, kind in fields.items()}
        return value.shape, kinds, value.dtype.itemsize, value.tolist()
    if isinstance(value, np.dtype):
        return {name: (kind[0].str, kind[1]) for name, kind in value.fields.items()}, value.itemsize
    if isinstance(value, list):
        return [{name: number.item() for name, number in one._asdict().items()} for one in value]
    return value


XYZ = [field(name, 4 * at, "f4") for at, name in enumerate("xyz")]
PADDED = [field("x", 0, "f4"), field("y", 4, "f4"), field("z", 8, "f4"), field("ring", 20, "u2")]
ODD = [field("b", 9, "f8"), field("a", 1, "i2"), field("", 4, "u1", 3), field("c", 0, "i1")]
ALL = [field(kind, 8 * at, kind) for at, kind in enumerate(KINDS)]
FLAT = np.arange(12, dtype="f4").reshape(4, 3)
NANS = np.where(FLAT % 5 == 2, np.float32(np.nan), FLAT)
PACKED = np.array([(1.5, 2, 3), (4.5, 5, 6)], [("x", "f8"), ("i", "u2"), ("j", "i1")])
MIXED = [field("x", 0, "f8"), field("i", 8, "u2"), field("j", 10, "i1")]
WITH_RING = [*XYZ, field("ring", 12, "u2")]
HOW = TransformStamped(header=Header(frame_id="map"))
HOW.transform.translation.x, HOW.transform.translation.z = 1.0, -2.0
turn = HOW.transform.rotation
turn.x, turn.y, turn.z, turn.w = 0.5, -0.5, 0.5, 0.5
read, create = point_cloud2.read_points, point_cloud2.create_cloud
header = Header(frame_id="h")

for question in (
    lambda: read(cloud(XYZ, 12, 3)),
    lambda: read(cloud(XYZ, 12, 3), ["z", "x"]),
    lambda: read(cloud(XYZ, 12, 3), ("y",)),
    lambda: read(cloud(PADDED, 32, 2)),
    lambda: read(cloud(PADDED, 32, 2), uvs=[1, 0, 1]),
    lambda: read(cloud(PADDED, 32, 4), uvs=np.array([2])),
    lambda: read(cloud(PADDED, 32, 4), uvs=iter([3, 2])),
    lambda: read(cloud(ODD, 20, 3)),
    lambda: read(cloud(ODD, 20, 3), ["unnamed_field_2_1", "a"]),
    lambda: read(cloud(ALL, 64, 2)),
    lambda: read(cloud(ALL, 64, 2, big=True)),
    lambda: read(cloud(ODD, 20, 3, big=True), ["b", "c"]),
    lambda: read(cloud(XYZ, 12, 2, 3)),
    lambda: read(cloud(XYZ, 12, 2, 3), reshape_organized_cloud=True),
    lambda: read(cloud(XYZ, 12, 2), reshape_organized_cloud=True),
    lambda: read(cloud(XYZ, 12, 0)),
    lambda: read(cloud(XYZ, 12, 4, data=NANS), skip_nans=True),
    lambda: read(cloud(XYZ, 12, 4, data=NANS), ["y"], True),
    lambda: read(cloud(XYZ, 12, 4, data=NANS, dense=True), skip_nans=True).shape,
    lambda: read(cloud(XYZ, 12, 2, 2, data=NANS), skip_nans=True, uvs=[0]),
    lambda: read(cloud(XYZ, 12, 5, data=FLAT)),
    lambda: read(cloud(XYZ, 12, 3), ["w"]),
    lambda: read(cloud([*XYZ, field("x", 0, "i4")], 12, 1)),
    lambda: read(cloud([field("x", 0, "f4", 0)], 4, 1)),
    lambda: read(Header()),
    lambda: point_cloud2.read_points_numpy(cloud(XYZ, 12, 3)),
    lambda: point_cloud2.read_points_numpy(cloud(XYZ, 16, 2, 3), ["x", "y"], reshape_organized_cloud=True),
    lambda: point_cloud2.read_points_numpy(cloud(PADDED, 32, 2), ["x", "z"]),
    lambda: point_cloud2.read_points_numpy(cloud(PADDED, 32, 2)),
    lambda: point_cloud2.read_points_list(cloud(PADDED, 32, 2)),
    lambda: point_cloud2.read_points_list(cloud(PADDED, 32, 2), ["ring", "x"]),
    lambda: point_cloud2.read_points_list(cloud(XYZ, 12, 4, data=NANS), skip_nans=True),
    lambda: point_cloud2.dtype_from_fields(ODD),
    lambda: point_cloud2.dtype_from_fields(ODD, point_step=32),
    lambda: point_cloud2.dtype_from_fields(field(name, 0, "u1", 2) for name in "ab"),
    lambda: point_cloud2.DUMMY_FIELD_PREFIX,
    lambda: create(header, XYZ, FLAT),
    lambda: create(header, XYZ, FLAT.astype("f8")),
    lambda: create(header, XYZ, FLAT[::2]),
    lambda: create(header, XYZ, FLAT.tolist()),
    lambda: create(header, XYZ, FLAT, 16),
    lambda: create(header, XYZ, FLAT.reshape(2, 2, 3)),
    lambda: create(header, MIXED, PACKED),
    lambda: create(header, MIXED, [(1, 2, 3), (4, 5, -6)]),
    lambda: create(header, MIXED, np.zeros((2, 3))),
    lambda: create(header, MIXED, PACKED[["x", "i"]]),
    lambda: create(header, XYZ, FLAT.reshape(1, 2, 2, 3)),
    lambda: create(header, [field("x", 0, "f4", 3)], FLAT),
    lambda: point_cloud2.create_cloud_xyz32(header, FLAT),
    lambda: point_cloud2.create_cloud_xyz32(header, [(1, 2, 3)]),
    lambda: point_cloud2.create_cloud_xyz32(header, []),
    lambda: transform_points(FLAT, HOW.transform),
    lambda: do_transform_cloud(cloud(XYZ, 12, 4, data=FLAT), HOW),
    lambda: do_transform_cloud(cloud(XYZ, 12, 4, data=FLAT), HOW.transform),
    lambda: do_transform_cloud(cloud(XYZ, 12, 4, data=NANS), Transform()),
    lambda: do_transform_cloud(create(header, WITH_RING, [(1, 2, 3, 4), (5, 6, 7, 8)]), HOW),
    lambda: do_transform_cloud(create(header, XYZ, FLAT.reshape(2, 2, 3)), HOW),
    lambda: do_transform_cloud(cloud(XYZ[:2], 8, 2), HOW),
):
    try:
        print(json.dumps(shown(question())))
    except Exception as error:
        print(json.dumps(type(error).__name__))
