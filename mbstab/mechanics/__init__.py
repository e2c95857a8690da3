"""What physics says: each physical element defined once, as symbols."""
