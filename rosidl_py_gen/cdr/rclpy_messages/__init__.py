"""Messages that behave like messages of rclpy, with the same codec as all others."""
