"""Keystores and policies of SROS2, without a ROS installation."""
