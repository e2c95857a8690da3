"""Comparisons: of methods, of integrators, with simulations, with expectations."""
