"""Command ``rosidl-py run``: finds a program written for rclpy, and runs or checks it."""
