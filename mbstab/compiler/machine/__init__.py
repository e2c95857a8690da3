"""A compiled program that follows the motion of any scene: an interpreter, a sparse factorization and the steps.

Nothing here is written for a scene: its equations come as numbers (`mbstab.compiler.trace.Code`), and the order of
elimination as lists of places. So Numba, the extra ``fast``, compiles these modules once, and keeps the result beside
them. Every function works on the arrays of a `mbstab.compiler.machine.tables.Machine`.
"""
