"""Command ``rosidl-py launch``: runs a launch file with the packages launch and launch_ros of ROS, which it imports."""
