"""The sections of a model file, each read by one of the modules here; `mbstab.model.reader` calls them."""
