"""Programs written for rclpy: finds a program, and runs or checks it."""
