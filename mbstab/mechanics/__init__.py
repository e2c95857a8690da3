"""What physics says: each physical element defined once, in any number system."""
