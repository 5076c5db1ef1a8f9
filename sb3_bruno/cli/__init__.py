"""The console script ``sb3-bruno``."""

import sys


def console() -> None:
    """Run a command, or say in one line which extra has to be installed."""
    try:
        from sb3_bruno.cli.main import main as run
    except ModuleNotFoundError as error:
        sys.exit(f"sb3-bruno: {error.name} is not installed: pip install 'sb3_bruno[zoo]'")
    run()
