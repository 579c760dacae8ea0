"""Mapping of nodes, topics and services of ROS to DDS, without calls of the DDS library."""
