"""The suite `speed`: what a picture costs."""
