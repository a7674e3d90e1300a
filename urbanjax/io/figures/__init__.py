"""Figures in one style, drawn without a display and without global state."""
