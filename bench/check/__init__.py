"""Golden values, tolerances, and the paper's claims."""
