"""Weights that make likely what recorded drivers did."""
