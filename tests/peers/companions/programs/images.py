"""Results of cv_bridge, one line for each call. Run under the real one and under ours."""

import json

import numpy as np
from cv_bridge import CvBridge, CvBridgeError, getCvType
from sensor_msgs.msg import Image
from std_msgs.msg import Header

rng = np.random.default_rng(9)
bridge = CvBridge()
NAMED = [f"{order}{bits}" for order in ("rgb", "bgr", "rgba", "bgra", "mono") for bits in (8, 16)]
BAYER = [f"bayer_{order}{bits}" for order in ("rggb", "bggr", "gbrg", "grbg") for bits in (8, 16)]
GENERIC = ["8UC1", "8UC3", "8SC1", "16UC1", "16SC1", "32SC1", "32FC1", "32FC3", "64FC1"]
PACKED = ["yuv422", "yuv422_yuy2"]


def to_hex(value, off):
    """Return integers in hex, in memory order; `off` is the accepted difference."""
    if isinstance(value, Image):
        head = value.height, value.width, value.encoding, int(value.is_bigendian), value.step, value.header.frame_id
        return *head, bytes(value.data).hex()
    if isinstance(value, np.ndarray):
        order = value.astype(value.dtype.newbyteorder("<"))
        values = value.tolist() if value.dtype.kind == "f" else order.tobytes().hex()
        return {"shape": value.shape, "dtype": value.dtype.name, "pixels": values, "off": off}
    return value


def ask(question, *arguments, off=0, **named):
    try:
        print(json.dumps(to_hex(question(*arguments, **named), off)))
    except Exception as error:
        print(json.dumps("TypeError" if isinstance(error, TypeError) else type(error).__name__))


def without_border(*arguments):
    """Remove the border of a Bayer pattern, which OpenCV and we interpolate differently."""
    return bridge.imgmsg_to_cv2(*arguments)[1:-1, 1:-1]


def approximate(source, target):
    """Print calculated values: brightness, YUV, Bayer."""
    is_reckoned = target in NAMED and (source in (*BAYER, *PACKED) or target.startswith("mono"))
    is_deep = source.endswith("16"), target.endswith("16")
    return is_reckoned * (2 if is_deep[0] else 257 if is_deep[1] else 1)


def image(encoding, height=2, width=4, padding=0, big=False):
    name, channels = bridge.encoding_to_dtype_with_channels(encoding)
    shape = height, width * channels
    if name.startswith("float"):
        values = rng.uniform(-300, 70000, shape).astype(name)
        values.flat[0], values.flat[1] = np.nan, 2.5
    else:
        info = np.iinfo(name)
        values = rng.integers(info.min, info.max, shape, name, endpoint=True)
    row = values.astype(values.dtype.newbyteorder(">" if big else "<")).view("u1").reshape(height, -1)
    data = np.hstack([row, np.full((height, padding), 77, "u1")])
    made = Image(height=height, width=width, encoding=encoding, step=data.shape[1], is_bigendian=int(big))
    made.data.frombytes(data.tobytes())
    return made


for encoding in (*NAMED, *BAYER, *GENERIC, *PACKED, "8U", "64FC4", "16SC7", "nothing", "8UC", ""):
    ask(getCvType, encoding)
    ask(bridge.encoding_to_dtype_with_channels, encoding)
ask(lambda: sorted(map(str, bridge.cvtype_to_name.items())))
ask(lambda: sorted(map(str, bridge.cvdepth_to_numpy_depth.items())))
ask(lambda: sorted(map(str, bridge.numpy_type_to_cvtype.items())))
ask(lambda: issubclass(CvBridgeError, TypeError))
ask(bridge.dtype_with_channels_to_cvtype2, np.dtype("float32"), 3)
ask(bridge.dtype_with_channels_to_cvtype2, np.dtype("int64"), 3)
for source in (*NAMED, *BAYER, *GENERIC, *PACKED):
    size = {"height": 6, "width": 6} if source in BAYER else {}
    ask(bridge.imgmsg_to_cv2, image(source, **size))
    ask(bridge.imgmsg_to_cv2, image(source, padding=24, **size))
    for target in (*NAMED, *GENERIC):
        if not (source in BAYER and target.startswith(("rgba", "bgra"))):
            question = without_border if source in BAYER else bridge.imgmsg_to_cv2
            ask(question, image(source, **size), target, off=approximate(source, target))
for encoding in ("16UC1", "32SC1", "32FC3", "mono16", "bgr16"):
    ask(bridge.imgmsg_to_cv2, image(encoding, big=True))
ask(bridge.imgmsg_to_cv2, Image(height=2, width=2, encoding="bgr8", step=6))
ask(bridge.imgmsg_to_cv2, Image(encoding="nothing"))
ask(bridge.imgmsg_to_cv2, image("bgr8"), "yuv422")
ask(bridge.imgmsg_to_cv2, image("bgr8"), "nothing")
small = rng.integers(0, 255, (2, 3, 3), "u1")
for pixels in (small, small[..., 0], small[..., :2], small.astype("f4"), small.astype(">u2"), small[::-1], small > 9):
    ask(bridge.cv2_to_imgmsg, pixels)
for encoding in ("bgr8", "rgb8", "8UC3", "mono8", "bgra8", "nothing", "16UC3"):
    ask(bridge.cv2_to_imgmsg, small, encoding)
ask(bridge.cv2_to_imgmsg, small[..., 0], "mono8", Header(frame_id="camera"))
ask(bridge.cv2_to_imgmsg, [1, 2])
ask(bridge.cv2_to_compressed_imgmsg, "no")
