"""One answer beside another: methods, integrators, simulation, expectations."""
