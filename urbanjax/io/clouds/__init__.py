"""Point clouds, maps of them and trajectories from files."""
