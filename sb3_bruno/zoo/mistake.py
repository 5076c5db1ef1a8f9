"""What the user can mend."""


class Mistake(Exception):
    """A mistake in the command, said in one line."""
