"""What classes of rclpy's flavour are made of: the same codec under messages that behave as rclpy's do.

`message` has the base classes, `fields` what is done with the value of a field, `checks` the checks of
ROS_PYTHON_CHECK_FIELDS, `arrays` what encoders and decoders call, `slot_types` the objects of `SLOT_TYPES`, `names` how
attributes are called.
"""
