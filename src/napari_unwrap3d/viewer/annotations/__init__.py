"""What is drawn on a cell: brushes, regions, shapes and points, and what they measure."""
