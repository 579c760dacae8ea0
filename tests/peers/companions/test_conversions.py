"""Properties of all clouds and images; features that the real packages lack; and their buffers."""

from __future__ import annotations

import textwrap
from pathlib import Path

import pytest
from support.environments import environment
from support.interface_packages import write
from support.program_processes import output_lines, run

pytestmark = pytest.mark.real_time("programs are processes")


def test_random_clouds_and_images_survive_round_trip(tmp_path: Path) -> None:
    text = """
        import numpy as np
        from cv_bridge import CvBridge
        from hypothesis import given, settings, strategies as st
        from hypothesis.extra import numpy as arrays
        from rosidl_py_gen.numpy import image_to_array, pointcloud_to_array
        from sensor_msgs.msg import PointField
        from sensor_msgs_py import point_cloud2
        from std_msgs.msg import Header

        kinds = st.sampled_from(["i1", "u1", "<i2", "<u2", "<i4", "<u4", "<f4", "<f8"])
        numbers = {kind: number for number, kind in point_cloud2._DATATYPES.items()}
        quick = settings(deadline=None, max_examples=60)

        @st.composite
        def clouds(draw):
            fields, at = [], draw(st.integers(0, 3))
            for index in range(draw(st.integers(1, 5))):
                kind, count = np.dtype(draw(kinds)), draw(st.integers(1, 3))
                fields.append(PointField(name=f"f{index}", offset=at, datatype=numbers[kind], count=count))
                at += kind.itemsize * count + draw(st.integers(0, 3))
            dtype = point_cloud2.dtype_from_fields(fields, at)
            shape = draw(st.tuples(st.integers(0, 4)) | st.tuples(st.integers(1, 3), st.integers(1, 3)))
            points = np.zeros(shape, dtype)
            for name in dtype.names:
                points[name] = draw(arrays.arrays(dtype[name], shape))
            return fields, at, points

        @quick
        @given(clouds())
        def cloud(drawn):
            fields, step, points = drawn
            made = point_cloud2.create_cloud(Header(), fields, points, step)
            read = point_cloud2.read_points(made, reshape_organized_cloud=True)
            ours = pointcloud_to_array(made).reshape(-1)
            for name in points.dtype.names:
                assert read[name].tobytes() == points[name].reshape(read.shape).tobytes()
            for field in fields:
                column, flat = ours[field.name], read.reshape(-1)
                names = [field.name] if field.count == 1 else [f"{field.name}_{n}" for n in range(field.count)]
                assert column.tobytes() == np.stack([flat[name] for name in names], -1).tobytes()

        bridge = CvBridge()
        shapes = st.tuples(st.integers(1, 4), st.integers(1, 4)) | st.tuples(*[st.integers(1, 5)] * 3)
        types = st.sampled_from(["u1", "i1", "<u2", ">u2", "<i2", "<i4", ">i4", "<f4", ">f4", "<f8"])

        @quick
        @given(types.flatmap(lambda kind: arrays.arrays(np.dtype(kind), shapes)))
        def image(pixels):
            message = bridge.cv2_to_imgmsg(pixels)
            back = bridge.imgmsg_to_cv2(message)
            expected = pixels[..., 0] if pixels.ndim == 3 and pixels.shape[2] == 1 else pixels
            np.testing.assert_array_equal(back, expected)
            np.testing.assert_array_equal(image_to_array(message), expected)
            assert back.dtype == pixels.dtype.newbyteorder("=") and back.dtype.isnative

        for check in (cloud, image):
            check()
            print(check.__name__)
    """
    assert output_lines(tmp_path, text) == ["cloud", "image"]


def test_conversions_are_correct_where_real_packages_are_not(tmp_path: Path) -> None:
    text = """
        import array
        import numpy as np
        import tf2_geometry_msgs
        from cv_bridge import CvBridge
        from geometry_msgs.msg import TransformStamped, Vector3Stamped
        from sensor_msgs.msg import Image, PointCloud2
        from sensor_msgs_py import point_cloud2
        from std_msgs.msg import Header
        from tf2_sensor_msgs import do_transform_cloud

        # Reading a big-endian cloud leaves it as it was.
        cloud = point_cloud2.create_cloud_xyz32(Header(), [(1, 2, 3)])
        cloud.data = array.array("B", np.array([1, 2, 3], ">f4").tobytes())
        cloud.is_bigendian = True
        print([point_cloud2.read_points_list(cloud)[0] == (1, 2, 3) for _ in range(2)])
        # Rows with bytes between them.
        rows = np.zeros((2, 5), "f4")
        rows[:, :3] = [(1, 2, 3), (4, 5, 6)]
        cloud = point_cloud2.create_cloud_xyz32(Header(), [(0, 0, 0)])
        cloud.height, cloud.row_step, cloud.data = 2, 20, array.array("B", rows.tobytes())
        print(point_cloud2.read_points_numpy(cloud).tolist())
        # A point that ends with bytes of no field.
        fields = [*cloud.fields, point_cloud2.PointField(name="i", offset=12, datatype=2, count=1)]
        cloud = point_cloud2.create_cloud(Header(), fields, [(1, 2, 3, 4)], 32)
        moved = do_transform_cloud(cloud, TransformStamped())
        print(moved.point_step, [*map(float, point_cloud2.read_points_list(moved)[0])])
        # Turning a vector does not change the transform; any frame name and subclasses are accepted.
        class Own(Vector3Stamped):
            pass

        how = TransformStamped()
        how.transform.translation.x = 3.0
        tf2_geometry_msgs.do_transform_vector3(Own(header=Header(frame_id="//base")), how)
        print(how.transform.translation.x)
        # Rows of an image that end with less bytes than a pixel has.
        image = Image(height=2, width=1, encoding="bgr8", step=4, data=[1, 2, 3, 9, 4, 5, 6, 9])
        print(CvBridge().imgmsg_to_cv2(image).tolist())
    """
    assert output_lines(tmp_path, text) == [
        "[True, True]",
        "[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]",
        "32 [1.0, 2.0, 3.0, 4.0]",
        "3.0",
        "[[[1, 2, 3]], [[4, 5, 6]]]",
    ]


COMPRESSED = """
    import numpy as np
    from cv_bridge import CvBridge, CvBridgeError
    from sensor_msgs.msg import CompressedImage

    bridge = CvBridge()
    gray = np.arange(40, dtype="u1").reshape(5, 8)
    colors = np.stack([gray * 2, gray, 255 - gray], -1)
    for pixels in (gray, gray[..., None], colors, np.dstack([colors, gray]), gray.astype("u2") * 999):
        message = bridge.cv2_to_compressed_imgmsg(pixels, "png")
        back = bridge.compressed_imgmsg_to_cv2(message)
        print(message.format, (back == pixels.reshape(back.shape)).all(), back.shape, back.dtype)
    message = bridge.cv2_to_compressed_imgmsg(colors)
    back = bridge.compressed_imgmsg_to_cv2(message)
    print(message.format, abs(back.astype(int) - colors).mean() < 12)
    print((bridge.compressed_imgmsg_to_cv2(message, "rgb8") == back[..., ::-1]).all())
    print(bridge.compressed_imgmsg_to_cv2(message, "mono8").shape)
    for pixels in (gray, np.dstack([colors, gray])):
        back = bridge.compressed_imgmsg_to_cv2(bridge.cv2_to_compressed_imgmsg(pixels, "png"), "rgb8")
        print(back.shape, (back[..., ::-1] == (pixels[..., :3] if pixels.ndim == 3 else gray[..., None])).all())
    for wrong in (
        lambda: bridge.compressed_imgmsg_to_cv2(CompressedImage(data=b"nothing")),
        lambda: bridge.compressed_imgmsg_to_cv2(CompressedImage()),
        lambda: bridge.compressed_imgmsg_to_cv2(message, "yuv422"),
        lambda: bridge.cv2_to_compressed_imgmsg(colors, "nothing"),
    ):
        try:
            print("no error", wrong())
        except CvBridgeError as error:
            print("CvBridgeError")
    try:
        print(len(bridge.cv2_to_compressed_imgmsg(colors, "bmp").data))
    except CvBridgeError as error:
        print(error)
"""
ALIKE = [
    "png True (5, 8) uint8",
    "png True (5, 8) uint8",
    "png True (5, 8, 3) uint8",
    "png True (5, 8, 4) uint8",
    "png True (5, 8) uint16",
    "jpg True",
    "True",
    "(5, 8)",
    *["(5, 8, 3) True"] * 2,
    *["CvBridgeError"] * 4,
]


def test_compressed_images_are_converted_by_pillow_without_opencv(tmp_path: Path) -> None:
    write(tmp_path, {"hidden/cv2.py": 'raise ImportError("not here")'})
    found = output_lines(tmp_path, COMPRESSED, PYTHONPATH=str(tmp_path / "hidden"))
    assert found == [
        *ALIKE,
        "bmp of uint8 with shape (5, 8, 3) needs OpenCV; install opencv-python-headless",
    ]
    write(tmp_path, {"hidden/PIL.py": 'raise ModuleNotFoundError("No module named \'PIL\'", name="PIL")'})
    write(
        tmp_path,
        {
            "bare.py": """
from cv_bridge import CvBridge, CvBridgeError
from sensor_msgs.msg import CompressedImage
try:
    CvBridge().compressed_imgmsg_to_cv2(CompressedImage())
except CvBridgeError as error:
    print(error)
"""
        },
    )
    bare = run("bare.py", cwd=tmp_path, PYTHONPATH=str(tmp_path / "hidden"))
    assert "PIL" in bare.stdout and "without OpenCV, images are read by Pillow" in bare.stdout, (
        bare.stdout + bare.stderr
    )


def test_compressed_images_are_converted_with_opencv(tmp_path: Path) -> None:
    python = environment("opencv", ["opencv-python-headless==4.10.0.84"])
    packages = next(python.parents[1].glob("[Ll]ib/**/site-packages"))
    more = """
        import cv2
        from cv_bridge import getCvType
        print(all(getCvType(name) == getattr(cv2, f"CV_{name}") for name in bridge.cvtype_to_name.values()))
        print((bridge.compressed_imgmsg_to_cv2(message) == cv2.imdecode(np.array(message.data), -1)).all())
    """
    found = output_lines(tmp_path, textwrap.dedent(COMPRESSED) + textwrap.dedent(more), PYTHONPATH=str(packages))
    assert found == [*ALIKE, "174", "True", "True"]


BUFFERS = """
    import math, threading
    import numpy as np
    import rclpy, tf2_geometry_msgs, tf2_sensor_msgs
    from geometry_msgs.msg import PointStamped, PoseStamped, PoseWithCovarianceStamped, TransformStamped, Vector3Stamped
    from rclpy.action import ActionServer
    from rclpy.duration import Duration
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.time import Time
    from sensor_msgs_py import point_cloud2
    from std_msgs.msg import Header
    from tf2_msgs.action import LookupTransform
    from tf2_msgs.msg import TF2Error
    import tf2_ros
    from tf2_ros import Buffer, BufferClient, BufferCore

    def at(parent, child, x, seconds=0.0, turned=0.0):
        made = TransformStamped(header=Header(frame_id=parent, stamp=Time(seconds=seconds).to_msg()))
        made.child_frame_id, made.transform.translation.x = child, x
        made.transform.rotation.z, made.transform.rotation.w = math.sin(turned / 2), math.cos(turned / 2)
        return made

    # Buffer.transform
    buffer = Buffer()
    buffer.set_transform_static(at("map", "base", 2.0, turned=math.pi / 2), "me")
    header = Header(frame_id="base")
    for message in (PointStamped(), Vector3Stamped(), PoseStamped(), PoseWithCovarianceStamped()):
        message.header = header
        moved = buffer.transform(message, "map")
        print(type(moved).__name__, moved.header.frame_id)
    moved = buffer.transform(point_cloud2.create_cloud_xyz32(header, [(1, 0, 0)]), "map")
    print(moved.header.frame_id, np.round(point_cloud2.read_points_numpy(moved), 6).tolist())

    # Velocities by the formula of tf2 for 3 m/s and half a radian in a second: x 3 cos a, y 3 sin a - x / 2 where a is
    # how far base has turned in the middle of the interval; tf2 multiplies the place of a point one by one.
    core = BufferCore()
    for seconds in range(5):
        core.set_transform(at("map", "base", 3.0 * seconds, seconds, seconds * 0.5), "me")
    core.set_transform_static(at("base", "arm", 1.0), "me")
    def shown(answer): return [[round(value, 3) + 0.0 for value in part] for part in answer]
    second = Duration(seconds=1)
    print(shown(core.lookupVelocityCore("base", "map", Time(seconds=2.5), second)))
    print(shown(core.lookupVelocityCore("base", "map", Time(), second)))
    print(shown(core.lookupVelocityCore("map", "base", Time(seconds=2.5), second)))
    asked = "base", "map", "map", (1.0, 2.0, 4.0), "base", Time(seconds=2.5), second
    print(shown(core.lookupVelocityFullCore(*asked)))
    for frames, error in ((("base", "no"), tf2_ros.LookupException), (("", "map"), tf2_ros.InvalidArgumentException)):
        try:
            core.lookupVelocityCore(*frames, Time(), second)
        except error as found:
            print(type(found).__name__)

    # BufferClient
    rclpy.init()
    node, asking = rclpy.create_node("server"), rclpy.create_node("asking")
    client = BufferClient(asking, "lookup", timeout_padding=Duration(seconds=5))
    try:
        client.lookup_transform("map", "base", Time())
    except tf2_ros.TimeoutException as error:
        print(error)
    def answer(goal):
        request, result = goal.request, LookupTransform.Result()
        time = Time.from_msg(request.source_time)
        try:
            if request.advanced:
                asked = request.target_frame, Time.from_msg(request.target_time), request.source_frame, time
                result.transform = core.lookup_transform_full_core(*asked, request.fixed_frame)
            else:
                result.transform = core.lookup_transform_core(request.target_frame, request.source_frame, time)
            goal.succeed()
        except tf2_ros.TransformException as error:
            kinds = {"LookupException": 1, "ConnectivityException": 2, "ExtrapolationException": 3}
            result.error.error = kinds.get(type(error).__name__, TF2Error.INVALID_ARGUMENT_ERROR)
            result.error.error_string = "as the server says"
            goal.abort()
        return result
    server = ActionServer(node, LookupTransform, "lookup", answer)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    executor.add_node(asking)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    client.action_client.wait_for_server()
    print(client.lookup_transform("map", "base", Time(seconds=3)).transform.translation.x)
    found = client.lookup_transform_full("base", Time(seconds=3), "base", Time(seconds=1), "map")
    print(round(math.hypot(found.transform.translation.x, found.transform.translation.y), 6))
    for asked in (("map", "no", 3), ("map", "base", 30), ("map", "", 3)):
        try:
            client.lookup_transform(*asked[:2], Time(seconds=asked[2]))
        except tf2_ros.TransformException as error:
            print(type(error).__name__, error)
    later = Time(seconds=30)
    print(client.can_transform("map", "base", Time()), client.can_transform("map", "base", later))
    print(client.can_transform_full("map", Time(), "base", Time(), "map"))
    point = PointStamped(header=Header(frame_id="arm"))
    print(client.transform(point, "base").point.x)
    try:
        client.lookup_transform("map", "base", 3)
    except TypeError as error:
        print(error)
    client.destroy()
    executor.shutdown()
    thread.join()
    rclpy.shutdown()
"""


def test_tf2_buffer_transforms_velocities_and_buffer_client_work(tmp_path: Path) -> None:
    assert output_lines(tmp_path, BUFFERS) == [
        *("PointStamped map", "Vector3Stamped map", "PoseStamped map", "PoseWithCovarianceStamped map"),
        "map [[2.0, 1.0, 0.0]]",
        "[[0.946, -0.903, 0.0], [0.0, 0.0, 0.5]]",
        "[[-1.248, -3.272, 0.0], [0.0, 0.0, 0.5]]",
        "[[0.991, -2.416, 0.0], [0.0, 0.0, -0.5]]",
        "[[0.946, -0.903, 2.0], [0.0, 0.0, 0.5]]",
        *("LookupException", "InvalidArgumentException"),
        "The BufferServer is not ready.",
        *("9.0", "6.0"),
        *(f"{kind}Exception as the server says" for kind in ("Lookup", "Extrapolation", "InvalidArgument")),
        *("True False", "True", "1.0"),
        "time: expected a rclpy.time.Time, got int",
    ]


def test_run_check_option_knows_names_of_companions(tmp_path: Path) -> None:
    text = """
        import tf2_geometry_msgs, tf2_ros, tf2_sensor_msgs
        from cv_bridge import CvBridge, CvBridgeError
        from cv_bridge.core import CvBridge
        from sensor_msgs_py import point_cloud2
        from sensor_msgs_py.point_cloud2 import read_points
        from tf2_ros.buffer_client import BufferClient
        from tf_transformations import quaternion_from_euler, quaternion_form_matrix
        point_cloud2.create_cloud_xyz
        tf2_geometry_msgs.do_transform_pose
        # What these only import for themselves, and programs import from them.
        from tf2_geometry_msgs import PoseStamped
        from tf2_ros import TransformStamped
        from tf2_ros.transform_broadcaster import TransformStamped
        from tf2_ros.transform_listener import Buffer
        tf2_ros.Duration, tf2_ros.Time, tf2_geometry_msgs.tf2_ros
    """
    write(tmp_path, {"program.py": textwrap.dedent(text)})
    found = run("--check", "program.py", cwd=tmp_path)
    assert found.stdout.splitlines() == [
        'program.py:8: tf_transformations has no quaternion_form_matrix; did you mean "quaternion_from_matrix"?',
        'program.py:9: sensor_msgs_py.point_cloud2 has no create_cloud_xyz; did you mean "create_cloud_xyz32"?',
        "2 missing in 1 file",
    ]
