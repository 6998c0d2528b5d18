"""The suite `latent`: what lies between codes, and what their differences mean."""
