"""Stub of launch_ros; see README of the folder above."""
