"""Sweeps: which values, what a sweep is named by, which of its jobs are done."""
