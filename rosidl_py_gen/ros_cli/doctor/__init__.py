"""What ``rosidl-py doctor`` looks at, and what it says about it."""
