"""From a plan to a solid pad: build123d taxels, their meshes, one pad, print checks and files."""
