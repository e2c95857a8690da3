"""The motion whose stability is asked about: given, at rest, steady, found, and what it is invariant under."""
