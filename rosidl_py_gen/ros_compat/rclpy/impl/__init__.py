"""Inner parts of rclpy that programs import all the same."""
