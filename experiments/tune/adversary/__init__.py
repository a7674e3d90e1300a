"""Failures found by gradient, beside random search and CMA-ES at equal rollouts."""
