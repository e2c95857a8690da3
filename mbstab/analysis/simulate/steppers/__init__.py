"""Methods that follow a motion, behind one interface."""
