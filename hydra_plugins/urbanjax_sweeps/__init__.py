"""How sweeps are made of a command line, and driven as one batch: plugins of Hydra."""
