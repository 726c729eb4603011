"""What is opened and saved: napari's readers, writers and samples, projects, and the autosave."""
