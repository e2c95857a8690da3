"""What is computed from the matrices: reference motion, linearization, eigenvalues."""
