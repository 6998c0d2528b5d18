"""Cabinets: chests, sideboards, wardrobes, shelves, hutches and kitchens. Metres."""
