"""Point clouds as arrays and back: the module `point_cloud2`."""
