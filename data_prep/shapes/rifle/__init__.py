"""Rifles and other long guns: a thin barrel, and a silhouette. The muzzle points to -Z."""
