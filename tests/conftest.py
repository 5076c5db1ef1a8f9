"""Settings that every test shares."""

import torch as th
from hypothesis import settings

# Small networks are fastest on one thread, and pytest-xdist has the other cores.
th.set_num_threads(1)

# The same examples on every run, however slow the machine.
settings.register_profile("sb3_bruno", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("sb3_bruno")
