"""Executables of ROS packages that describe robots, as `main` functions for `rosidl-py run` and launch files."""
