"""Readers of point clouds and trajectories, and point-cloud maps on disk."""

from urbanjax.io.clouds.pointclouds import read

__all__ = ["read"]
