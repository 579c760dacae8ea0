"""Many bags as one dataset: sources (which), manifest (what is there), tasks, datasets (all), cluster (Dask)."""
