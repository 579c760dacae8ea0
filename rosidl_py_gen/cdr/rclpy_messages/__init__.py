"""Message classes that behave like the classes of a ROS installation, with the CDR codec that all generated messages
use.
"""
