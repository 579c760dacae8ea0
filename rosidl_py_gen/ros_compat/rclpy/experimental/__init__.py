"""Experimental parts of rclpy."""

from rclpy.experimental.events_executor import EventsExecutor
