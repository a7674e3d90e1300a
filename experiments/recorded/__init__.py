"""Closed loop in the place of every recorded driver."""
