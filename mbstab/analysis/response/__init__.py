"""Inputs and outputs: state space, transfer functions, zeros, margins."""
