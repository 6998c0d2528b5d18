"""Datasets: objects by class, with clouds, views and true images."""
