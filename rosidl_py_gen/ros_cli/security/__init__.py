"""Command group ``rosidl-py security``: keystores of SROS2, without a ROS installation."""
