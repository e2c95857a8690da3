"""Values of parameters that are best for a goal."""
