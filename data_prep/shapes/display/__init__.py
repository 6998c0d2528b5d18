"""Displays: monitors, televisions, tubes and signs. Metres; the screen looks to -Z."""
