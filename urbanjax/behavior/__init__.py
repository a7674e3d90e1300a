"""Path selection (TSPS) and velocity planning (GVP)."""
