"""Publish images that numpy makes, as a camera would: python examples/camera.py; stop with Ctrl-C.

A bright disc goes round on ``image``, and how far away it is on ``depth``. Look at it with
``rosidl-py topic echo /image --no-arr``, or record it: ``rosidl-py bag record /image /depth``. Seen, once a second:

    10 images of 320x240, rgb8 and 32FC1
"""

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from rosidl_py_gen.numpy import array_to_image
from rosidl_py_gen.runtime import Node, QoSProfile, run

WIDTH, HEIGHT, HZ = 320, 240, 10
ROWS, COLUMNS = np.mgrid[:HEIGHT, :WIDTH]


def disc(angle: float) -> NDArray[np.bool_]:
    """Which pixels are on the disc, shape (rows, columns)."""
    row, column = HEIGHT / 2 + 80 * np.sin(angle), WIDTH / 2 + 80 * np.cos(angle)
    inside: NDArray[np.bool_] = np.hypot(ROWS - row, COLUMNS - column) < 30
    return inside


def picture(on_disc: NDArray[np.bool_]) -> NDArray[np.uint8]:
    pixels = np.full((HEIGHT, WIDTH, 3), 40, np.uint8)
    pixels[on_disc] = (255, 160, 0)
    return pixels


def distances(on_disc: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Metres; NaN where the camera sees nothing."""
    return np.where(on_disc, 1.5, np.nan).astype(np.float32)


async def main() -> None:
    async with Node("camera") as node:
        newest = QoSProfile(depth=1).best_effort()
        images = node.create_publisher(Image, "image", newest)
        depths = node.create_publisher(Image, "depth", newest)
        rate = node.create_rate(HZ)
        number = 0
        while True:
            header = Header(stamp=node.clock.now().to_msg(), frame_id="camera")
            on_disc = disc(number / HZ)
            images.publish(array_to_image(picture(on_disc), "rgb8", header=header, cls=Image))
            depths.publish(array_to_image(distances(on_disc), header=header, cls=Image))
            number += 1
            if number % HZ == 0:
                print(f"{number} images of {WIDTH}x{HEIGHT}, rgb8 and 32FC1", flush=True)
            await rate.sleep()


if __name__ == "__main__":
    run(main)
