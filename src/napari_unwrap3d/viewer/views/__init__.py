"""The charts of a cell in both canvases: their layers, colours, depths, and the linked cursor."""
