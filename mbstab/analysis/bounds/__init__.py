"""Error bounds: discs of the complex plane that contain the eigenvalues."""
