"""The suite `latent`: paths between codes, and sums of codes."""
