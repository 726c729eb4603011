"""What the benchmarks share: cases, measures, child processes, and the file of results."""
