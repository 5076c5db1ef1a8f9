"""The console script ``sb3-bruno``."""

import sys


def main() -> None:
    """The console script; it says in one line which extra is missing."""
    try:
        from sb3_bruno.cli.main import main as run
    except ModuleNotFoundError as error:
        sys.exit(f"sb3-bruno: {error.name} is not installed: pip install 'sb3_bruno[zoo]'")
    run()
