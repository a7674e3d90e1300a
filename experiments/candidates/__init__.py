"""Candidate trajectories beside Frenetix, agreement first and then time."""
