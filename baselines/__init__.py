"""Renderers without pc2pix: surface reconstruction and other methods, floor and ceiling."""
