"""From definitions to kernels, from kernels to the matrices of a scene."""
