"""Surface reconstruction: from a cloud to a mesh, by the paper's chain and by others."""
