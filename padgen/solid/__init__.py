"""Plan → build123d taxels → meshes → one pad → print checks → files."""
