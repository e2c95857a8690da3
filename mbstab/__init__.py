"""Tells whether a motion of a constrained mechanical system is stable, and how far each number can be trusted."""
