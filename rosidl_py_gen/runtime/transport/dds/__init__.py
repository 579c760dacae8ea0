"""How ROS puts nodes, topics and services on top of DDS, whatever library carries it.

May import: what transport may.
"""
