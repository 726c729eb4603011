"""What napari shows: one package for each thing that a person works with, and what is common."""
