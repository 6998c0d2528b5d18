"""The steps from a protocol to jobs, executors and a finished run."""
