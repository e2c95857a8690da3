"""Eigenvalues as answers: all or a few of them, many digits, periodic motions, modes, derivatives."""
