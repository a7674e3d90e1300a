"""Polylines, Frenet frames, splines and boxes."""
