"""Conversion of point clouds to arrays and back."""
