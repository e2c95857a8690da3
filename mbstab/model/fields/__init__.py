"""The kinds of fields an entry may have: one class each, with all that the package asks of it.

A new kind is a class in one of the modules here, with a ``name``. Tables in
`mbstab.mechanics` name it in `Field.shape`.
"""
