"""A world to drive in."""
