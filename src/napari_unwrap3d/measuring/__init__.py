"""Measuring: series, events, correlations and speeds of what was tracked, and a report."""
