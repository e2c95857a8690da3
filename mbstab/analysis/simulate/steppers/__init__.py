"""Integration methods with a common interface."""
