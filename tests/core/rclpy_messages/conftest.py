"""Messages of rclpy's API."""

from support.rclpy_messages import message_api

__all__ = ["message_api"]
