"""Tracks on a movie: followed, shown, edited, measured, plotted and kept in files."""
