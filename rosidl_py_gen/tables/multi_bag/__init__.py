"""Conversion of many bags to one Parquet dataset, in this process or in several processes."""
