"""Families of situations, each a function of a random key and parameters."""
