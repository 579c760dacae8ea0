"""Results of image_geometry, one line for each call. Run under the real one and under ours, with OpenCV."""

import json

import numpy as np
from image_geometry import PinholeCameraModel, StereoCameraModel
from sensor_msgs.msg import CameraInfo

rng = np.random.default_rng(11)


def told(value):
    if isinstance(value, np.ndarray):
        return [type(value).__name__, list(value.shape), [float(one) for one in np.asarray(value).ravel()]]
    if hasattr(value, "get_fields_and_field_types"):
        return [type(value).__name__, *(told(getattr(value, name)) for name in value.get_fields_and_field_types())]
    if isinstance(value, np.generic):
        return value.item()
    return [told(one) for one in value] if isinstance(value, list | tuple) else value


def ask(what):
    try:
        answer = told(what())
    except Exception as error:
        answer = type(error).__name__
    print(json.dumps(answer))


def info(distorted=True, binning=(0, 0), roi=(0, 0, 0, 0), shift=0.0):
    made = CameraInfo(width=640, height=480, binning_x=binning[0], binning_y=binning[1])
    made.header.frame_id = "camera"
    made.header.stamp.sec = 3
    fx, fy, cx, cy = rng.uniform(300, 500), rng.uniform(300, 500), rng.uniform(280, 340), rng.uniform(200, 260)
    made.k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    made.d = list(rng.uniform(-0.2, 0.2, 5)) if distorted else []
    made.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    made.p = [fx * 0.9, 0.0, cx + 2, shift, 0.0, fy * 0.9, cy - 3, 0.0, 0.0, 0.0, 1.0, 0.0]
    made.roi.x_offset, made.roi.y_offset, made.roi.width, made.roi.height = roi
    return made


NAMES = ["fullResolution", "intrinsicMatrix", "distortionCoeffs", "rotationMatrix", "projectionMatrix"]
NAMES += ["fullIntrinsicMatrix", "fullProjectionMatrix", "cx", "cy", "fx", "fy", "Tx", "Ty", "fovX", "fovY", "tfFrame"]
ATTRIBUTES = ["K", "D", "R", "P", "full_K", "full_P", "width", "height", "binning_x", "binning_y"]
ATTRIBUTES += ["raw_roi", "tf_frame", "stamp"]

bare = PinholeCameraModel()
for attribute in ATTRIBUTES:
    ask(lambda attribute=attribute: getattr(bare, attribute))
for name in NAMES:
    ask(lambda name=name: getattr(bare, name)())
ask(lambda: bare.project3dToPixel((0.0, 0.0, 1.0)))
for given in (
    info(),
    info(distorted=False),
    info(binning=(2, 4)),
    info(roi=(10, 20, 300, 200)),
    info(binning=(2, 1), roi=(7, 0, 64, 48), shift=-30.0),
):
    camera = PinholeCameraModel()
    ask(lambda camera=camera, given=given: camera.fromCameraInfo(given))
    for attribute in ATTRIBUTES:
        ask(lambda camera=camera, attribute=attribute: getattr(camera, attribute))
    for name in NAMES:
        ask(lambda camera=camera, name=name: getattr(camera, name)())
    for point in (*rng.uniform(-3, 3, (4, 3)), (0.0, 0.0, 0.0), (1, 2, 3)):
        ask(lambda camera=camera, point=point: camera.project3dToPixel(point))
    for pixel in (*rng.uniform(0, 480, (4, 2)), (0, 0)):
        ask(lambda camera=camera, pixel=pixel: camera.projectPixelTo3dRay(pixel))
        ask(lambda camera=camera, pixel=pixel: camera.rectifyPoint(pixel))
    for name in ("getDeltaU", "getDeltaV", "getDeltaX", "getDeltaY"):
        for values in ((17.0, 2.0), (-1, 3), (1.0, 0), (0, 0.0)):
            ask(lambda camera=camera, name=name, values=values: getattr(camera, name)(*values))
    raw = (rng.integers(0, 255, (480, 640)) // 64 * 64).astype(np.uint8)
    rectified = np.zeros_like(raw)
    ask(lambda camera=camera, raw=raw, rectified=rectified: camera.rectifyImage(raw, rectified))
    ask(lambda camera=camera: [camera.mapx.shape, camera.mapy.dtype.name, float(camera.mapx.sum())])
    print(json.dumps({"shape": [5], "dtype": "uint8", "off": 1, "pixels": rectified[::97, 300].tobytes().hex()}))

stereo = StereoCameraModel()
ask(lambda: stereo.getZ(3.0))
left = info()
right = info(shift=-26.5)
right.p = [*left.p[:3], -26.5, *left.p[4:]]
ask(lambda: stereo.fromCameraInfo(left, right))
ask(lambda: stereo.Q)
ask(stereo.tfFrame)
for pixel in rng.uniform(0, 480, (5, 2)):
    for disparity in (0, 1, 2.5):
        ask(lambda pixel=pixel, disparity=disparity: stereo.projectPixelTo3d(pixel, disparity))
for point in (*rng.uniform(-3, 3, (4, 3)), (0.0, 0.0, 0.0)):
    ask(lambda point=point: stereo.project3dToPixel(point))
for value in (0, 0.0, 2, 0.5, -1.0):
    ask(lambda value=value: stereo.getZ(value))
    ask(lambda value=value: stereo.getDisparity(value))
ask(lambda: StereoCameraModel().fromCameraInfo(info(), info()))
