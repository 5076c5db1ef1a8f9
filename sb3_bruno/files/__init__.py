"""How files are written, whole and sealed with a checksum, and how what they say is shown. Knows the standard library alone."""
