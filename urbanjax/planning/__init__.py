"""Prediction, macro and micro motion planning."""
