"""Generated: nothing here is to be read or edited. ``python -m mbstab.compiler.emit`` makes the kernels again.

Each is what `mbstab.compiler.emit` writes for one element of `mbstab.mechanics`; why they are kept is said there.
"""
