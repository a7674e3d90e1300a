"""Figures in one style, drawn without a display and without global state."""

from urbanjax.io.figures.drives import drive

__all__ = ["drive"]
