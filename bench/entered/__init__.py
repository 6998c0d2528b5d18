"""Methods that are entered by images: what their authors state, and the images."""
