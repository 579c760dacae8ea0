"""Message classes that behave like rclpy's, with the codec of all generated messages."""
