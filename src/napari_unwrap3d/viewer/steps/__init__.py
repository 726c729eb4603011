"""The steps from a stack to the charts: a panel for each, and the pipeline in a thread."""
