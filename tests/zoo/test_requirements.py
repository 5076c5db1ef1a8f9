"""What zoo/ and cli/ import is required by name, not by way of another library."""

import ast
import configparser
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

ROOT = Path(__file__).parents[2]


def imported():
    """The libraries that files of zoo/ and cli/ import."""
    for room in ("zoo", "cli"):
        for path in (ROOT / "sb3_bruno" / room).glob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Import):
                    yield from (alias.name.split(".")[0] for alias in node.names)
                elif isinstance(node, ast.ImportFrom):
                    yield node.module.split(".")[0]


def normal(name):
    return name.lower().replace("_", "-")


def test_the_extra_names_every_library_that_is_imported():
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg")
    extras = setup["options.extras_require"]
    lines = "\n".join([setup["options"]["install_requires"], extras["plots"], extras["zoo"]]).splitlines()
    required = {normal(line.split()[0].split("[")[0]) for line in lines if line.strip() and line.strip()[0] != "#"}
    libraries = set(imported()) - sys.stdlib_module_names - {"sb3_bruno", "sb3_bruno_envs"}
    found = packages_distributions()
    assert [name for name in libraries if not required & {normal(dist) for dist in found[name]}] == []
