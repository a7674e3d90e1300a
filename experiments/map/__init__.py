"""A picture of any map and what looks wrong in it."""
