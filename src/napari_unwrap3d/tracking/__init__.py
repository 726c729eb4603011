"""Tracking: protrusions and regions of the surface, followed over time."""
