"""What sweeps amount to: one table, one report, the best values."""
