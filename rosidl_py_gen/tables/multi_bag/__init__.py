"""Many bags as one dataset: sources, manifest (finished tasks), tasks, datasets (all), pool, cluster (Dask)."""
