"""The harness: suites, methods, metrics, runs, records, tables, checks, command line."""
