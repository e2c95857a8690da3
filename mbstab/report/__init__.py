"""Results as text and files."""

WIDTH = 80
"""Width of wrapped text in columns; tables are as wide as their numbers need."""
