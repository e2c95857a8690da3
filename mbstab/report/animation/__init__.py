"""Motions as moving pictures."""
