"""Images of meshes and clouds by the one camera of the project."""
