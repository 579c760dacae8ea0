"""``rosidl-py run``: finds a program written for rclpy, and runs it as python would, or says what it lacks."""
