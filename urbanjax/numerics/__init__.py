"""Pure mathematics of arrays."""
