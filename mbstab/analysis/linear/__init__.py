"""The linearized equations: eigenvalues, how far each can be trusted, and the verdict."""
