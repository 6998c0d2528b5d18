"""Cars: one body colour, tinted windows, black tyres. Metres; the nose points to -Z."""
