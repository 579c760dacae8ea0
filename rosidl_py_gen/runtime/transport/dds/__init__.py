"""Mapping of nodes, topics and services of ROS to DDS, independent of the DDS library.

May import: what transport may.
"""
