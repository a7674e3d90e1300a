"""Closed loop in highway-env, beside highway-env's own IDM vehicle."""
