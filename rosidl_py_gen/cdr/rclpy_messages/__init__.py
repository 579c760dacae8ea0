"""Messages that behave as those of rclpy, with the same codec as all others."""
