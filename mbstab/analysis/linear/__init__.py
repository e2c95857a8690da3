"""The linearized equations of motion: matrices, deflation, errors of their entries, other formulations."""
