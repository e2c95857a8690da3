"""Generated kernels of the built-in elements; regenerate with python -m mbstab.compiler.emit."""
