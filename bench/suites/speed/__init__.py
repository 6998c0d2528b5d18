"""The suite `speed`: the cost of an image."""
