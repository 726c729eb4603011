"""Parts that every dock is made of, and work in threads; they know nothing of cells."""
