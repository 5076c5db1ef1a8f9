"""How files are written, whole and sealed with a checksum, and what they say is shown. Knows the standard library."""
