"""Executables of ROS packages that describe robots, in Python: ``robot_state_publisher``, ``joint_state_publisher``
and ``static_transform_publisher`` of tf2_ros.

`rosidl-py run` and launch files start their `main` functions under the names of the ROS packages.
"""
