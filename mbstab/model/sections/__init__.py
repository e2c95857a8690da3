"""The sections of a model file: one module for what is read alike, called by `mbstab.model.reader`."""
