"""Many independent tasks on worker processes, here or on a Dask cluster."""
