"""Loudspeakers: boxes with round drivers, and other things that sound. Metres."""
