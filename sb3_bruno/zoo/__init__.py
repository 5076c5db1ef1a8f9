"""RL Zoo and Optuna for task inference: what ``sb3-bruno`` on the command line is made of."""

import sys


def main() -> None:
    """The console script; it says in one line which extra is missing."""
    try:
        from sb3_bruno.zoo.cli import main as run
    except ModuleNotFoundError as error:
        sys.exit(f"sb3-bruno: {error.name} is not installed: pip install 'sb3_bruno[zoo]'")
    run()
