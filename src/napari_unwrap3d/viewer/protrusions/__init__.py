"""The protrusions of a cell: shown, selected, edited, and in a table."""
