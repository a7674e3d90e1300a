"""From an observation to a pose."""
