"""Results as text and files."""

WIDTH = 80
"""Columns of a terminal that text is wrapped to; tables are as wide as their numbers need."""
