"""The console script ``sb3-bruno``."""

import sys


def console() -> None:
    """Run a command, or say in one line which extra has to be installed."""
    from sb3_bruno.cli.main import main

    try:
        main()
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] not in OF_THE_EXTRA:
            raise
        sys.exit(f"sb3-bruno: {error.name} is not installed: pip install 'sb3_bruno[zoo]'")


OF_THE_EXTRA = {
    "huggingface_sb3",
    "imageio_ffmpeg",
    "matplotlib",
    "moviepy",
    "optuna",
    "pandas",
    "psutil",
    "rl_zoo3",
    "scipy",
    "yaml",
}
"""Libraries that only the command line needs."""
