"""What methods, metrics and datasets have to keep to, and whether they do."""
