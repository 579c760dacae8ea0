"""What ``rosidl-py tf`` does: frames as a tree, one transform, and how often and how late transforms come."""
