"""Many bags as one dataset."""
