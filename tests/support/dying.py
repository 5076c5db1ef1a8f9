"""A process that dies at an aimed moment."""

import os

import torch as th


def dies_at(moment, act):
    """Act in a child process, which dies without a farewell as soon as it calls ``os.<moment>``."""
    child = os.fork()
    if child == 0:
        setattr(os, moment, lambda *_: os._exit(9))
        th.cuda.is_available = lambda: False  # a forked process has no GPU
        try:
            act()
        finally:
            os._exit(0)  # also after an error: the child must not go on with the parent's tests
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
