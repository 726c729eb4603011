"""Many files, cells and movies at once."""
