"""How files are written: whole or not at all, and sealed with a checksum. Knows the standard library alone."""
