"""Experimental parts of rclpy."""

from __future__ import annotations

from rclpy.experimental.events_executor import EventsExecutor as EventsExecutor
