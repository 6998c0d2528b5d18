"""A user's own cloud: drawn by a method, or made smaller until only its failure is left."""
