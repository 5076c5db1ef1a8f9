"""``--help`` answers at once, and names every command and flag."""

import importlib
import re
import subprocess
import sys

import pytest

from sb3_bruno.cli.main import COMMANDS
from sb3_bruno.cli.upstream import replaced


def test_nobody_waits_for_torch_to_be_told_how_to_call_it():
    """The libraries that take seconds to import are not imported."""
    script = (
        "import sys\n"
        "from sb3_bruno.cli.main import COMMANDS, main\n"
        "commands = [[name, '--help'] for name in COMMANDS]\n"
        "commands += [['sweep', name, '--help'] for name in ('init', 'run', 'status', 'best', 'export')]\n"
        "for arguments in (['--help'], ['--version'], ['trian'], ['evaluate', '--steps', '0'], *commands):\n"
        "    try:\n"
        "        main(arguments)\n"
        "    except SystemExit:\n"
        "        pass\n"
        "sys.exit(' '.join({'optuna', 'rl_zoo3', 'sqlalchemy', 'torch'} & sys.modules.keys()) or 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "sb3-bruno 0.1.0" in done.stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(run, command):
    printed, _ = run(command, "--help")
    assert f"example: sb3-bruno {command}" in printed
    assert ("--out" if command in ("report", "pull") else "--env") in printed


def test_help_names_every_command(run):
    printed, mistake = run("--help")
    assert mistake == "0" and all(f"  {command} " in printed for command in COMMANDS)


@pytest.mark.parametrize("script", ["train", "enjoy"])
def test_help_names_every_flag_of_rl_zoos(run, script, capsys):
    with pytest.raises(SystemExit), replaced(vars(sys), "argv", [script, "--help"]):
        getattr(importlib.import_module(f"rl_zoo3.{script}"), script)()
    theirs = set(re.findall(r"--[a-z0-9-]+", capsys.readouterr().out))
    assert len(theirs) > 15 and theirs <= set(re.findall(r"--[a-z0-9-]+", run(script, "--help")[0]))
