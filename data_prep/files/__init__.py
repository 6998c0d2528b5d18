"""Files of clouds and meshes, read without trust and written whole or not at all."""
