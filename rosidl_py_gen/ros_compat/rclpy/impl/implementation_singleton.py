"""Module ``rclpy_implementation``, which is rclpy's C extension."""

import rclpy._rclpy_pybind11 as rclpy_implementation

package = "rclpy"
