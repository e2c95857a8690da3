"""Answers that are theorems: everything in balls."""
