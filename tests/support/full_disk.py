"""A disk that is full: the system refuses to let any file of this process grow beyond a few bytes."""

import resource
from contextlib import contextmanager


@contextmanager
def full_disk(room=2_000):
    """Refuse, within the block, files of more than ``room`` bytes, by an OSError in mid-write."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
