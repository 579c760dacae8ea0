"""Module with the name ``rclpy_implementation`` for rclpy's C extension."""

import rclpy._rclpy_pybind11 as rclpy_implementation

package = "rclpy"
