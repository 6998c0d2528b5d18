"""The suite `speed`: what an image costs."""
