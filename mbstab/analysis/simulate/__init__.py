"""The nonlinear motion."""
