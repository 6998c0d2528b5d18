"""Statistics over records: intervals, paired comparison, frontier, crossings, recommendation."""
