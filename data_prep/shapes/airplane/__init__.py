"""Airplanes: thin wings on slim bodies. Lengths are in fuselages; the nose points to -Z."""
