"""Statistics over records: intervals, paired comparison, frontier, sweeps."""
