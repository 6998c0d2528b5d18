"""Sofas: of one to four seats, the seat open towards -Z. Metres."""
