"""Programs that import rclpy's companions run in processes of their own: here nothing of them is imported."""

from worlds import only_loopback

__all__ = ["only_loopback"]
