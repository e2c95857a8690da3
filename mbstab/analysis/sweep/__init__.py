"""Eigenvalues over one or two parameters."""
