"""Lamps: the class that varies most, much of it thin rods. A lamp has no front. Metres."""
