"""Results as pictures, drawn with matplotlib."""

import logging

# It finds another place for its fonts where it may not write, and need not print a warning.
logging.getLogger("matplotlib").setLevel(logging.ERROR)
