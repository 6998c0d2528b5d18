"""Benches to sit on, of the class "bench" (the package `bench` is the benchmark). Front: -Z."""
