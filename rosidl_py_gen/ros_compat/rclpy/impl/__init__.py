"""Internal modules of rclpy; some programs import them."""
