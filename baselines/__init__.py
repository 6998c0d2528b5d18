"""Renderers that pc2pix is compared with: surface reconstruction, splats, ceiling and floor."""
