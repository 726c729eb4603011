"""Movies: one cell over time, in a common space where a place on it keeps its (u, v)."""
