"""The house stays as it was built: imports point down, setup.cfg knows every package, configs agree."""

import ast
import configparser
import graphlib
import importlib
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
ROOMS = {  # each room, from the ground up, and the rooms that it may import
    "maths": set(),
    "encoders": {"maths"},
    "buffers": {"encoders"},
    "task_names": set(),
    "task_words": set(),
    "algorithms": {"buffers", "encoders", "task_names", "task_words"},
    "": {"algorithms", "buffers", "encoders"},  # the package's face
    "files": set(),
    "evaluation": {"files", "task_names"},
    "runs": {"evaluation", "files", "task_names"},
    "plotting": {"algorithms", "encoders", "evaluation", "task_names"},
    "diagnostics": {"algorithms", "encoders", "evaluation", "files", "plotting", "task_names"},
    "resume": {"algorithms", "files"},
    "export": {"", "algorithms", "buffers", "encoders", "evaluation", "files", "maths", "runs", "task_words"},
    "report": {"evaluation", "files", "plotting", "runs", "task_names"},
    "zoo": {"", "algorithms", "encoders", "evaluation", "export", "files", "resume", "runs", "task_names"},
    "live": {"algorithms", "encoders", "evaluation", "plotting", "runs", "task_names", "zoo"},
    "cli": {
        "",
        "algorithms",
        "diagnostics",
        "evaluation",
        "export",
        "files",
        "live",
        "plotting",
        "report",
        "runs",
        "zoo",
    },
    "quickstart": {"", "evaluation", "files", "plotting", "resume", "runs"},
}
KNOWS = {  # beyond the standard library, numpy and the rooms below
    "maths": {"torch", "zuko"},
    "encoders": {"torch", "typing_extensions", "zuko"},
    "files": set(),
    "task_names": set(),
    "task_words": set(),
    "evaluation": {"gymnasium", "rliable", "stable_baselines3", "tqdm"},
    "runs": {"filelock", "pandas", "torch"},
}


def name_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT / "sb3_bruno").with_suffix("").parts).removesuffix("__init__").strip(".")


def imports_of(path: Path) -> set[str]:
    """Modules that a file imports when it is imported."""
    tree = ast.parse(path.read_text())
    checking = {id(n) for node in ast.walk(tree) if _is_type_checking(node) for n in ast.walk(node)}
    found = set()
    for node in ast.walk(tree):
        if id(node) in checking:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}: relative import"
            found.add(node.module)
    return found


def _is_type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


FILES = {name_of(path): path for path in sorted((ROOT / "sb3_bruno").rglob("*.py"))}
ENV_FILES = sorted((ROOT / "envs" / "sb3_bruno_envs").rglob("*.py"))


def room_of(name: str) -> str:
    return name.split(".")[0]


def ours(name: str) -> set[str]:
    """The modules of the package that a file imports, by their names in it."""
    found = {module for module in imports_of(FILES[name]) if module.split(".")[0] == "sb3_bruno"}
    return {module.removeprefix("sb3_bruno").removeprefix(".") for module in found}


@pytest.mark.parametrize("name", FILES)
def test_imports_point_down(name):
    below = {room_of(module) for module in ours(name)} - {room_of(name)}
    assert below <= ROOMS[room_of(name)]


def test_rooms_stand_on_those_below():
    floors = list(ROOMS)
    assert {room_of(name) for name in FILES} == set(floors)
    assert all(floors.index(below) < floors.index(room) for room, rooms in ROOMS.items() for below in rooms)


def test_no_imports_in_a_circle():
    tuple(graphlib.TopologicalSorter({name: ours(name) for name in FILES}).static_order())


@pytest.mark.parametrize("name", [name for name in FILES if room_of(name) in KNOWS])
def test_a_room_knows_no_more_than_it_may(name):
    known = KNOWS[room_of(name)] | {"numpy", "sb3_bruno"} | sys.stdlib_module_names
    assert {module.split(".")[0] for module in imports_of(FILES[name])} <= known


@pytest.mark.parametrize("path", ENV_FILES, ids=lambda path: path.stem)
def test_envs_know_neither_the_algorithm_nor_torch(path):
    tops = {module.split(".")[0] for module in imports_of(path)}
    assert not tops & {"sb3_bruno", "torch", "stable_baselines3", "sb3_contrib", "zuko"}


def test_the_algorithm_knows_no_env_outside_the_main_job():
    for name, path in FILES.items():
        assert name == "quickstart" or "sb3_bruno_envs" not in {module.split(".")[0] for module in imports_of(path)}


def test_setup_cfg_lists_every_package_on_disk():
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg")
    listed = set(setup["options"]["packages"].split())
    roots = {"sb3_bruno": ROOT / "sb3_bruno", "sb3_bruno_envs": ROOT / "envs" / "sb3_bruno_envs"}
    found = {
        ".".join([package, *path.parent.relative_to(root).parts])
        for package, root in roots.items()
        for path in root.rglob("__init__.py")
    }
    assert listed == found | {"sb3_bruno.zoo_configs"}  # YAML alone
    assert not (ROOT / "envs" / "__init__.py").exists()


def test_every_dependency_has_an_exact_tested_version():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pinned = {line.split("==")[0].lower().replace("_", "-") for line in lines if line and not line.startswith("#")}
    assert all("==" in line for line in lines if line and not line.startswith("#"))
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg")
    needed = setup["options"]["install_requires"] + "".join(setup["options.extras_require"].values())
    for line in needed.splitlines():
        requirement = line.split("#")[0].strip()
        if requirement and not requirement.startswith("sb3_bruno["):
            name = requirement.split("[")[0].split(" ")[0].split(">")[0].split("<")[0]
            assert name.lower().replace("_", "-") in pinned, name


def test_the_quickstart_trains_with_the_zoos_hyperparameters_but_for_those_of_a_shorter_run():
    from sb3_bruno import quickstart

    shorter = {"batch_size", "replay_buffer_kwargs", "encoder_update_ratio", "learning_rate", "encoder_learning_rate"}
    config = yaml.safe_load((ROOT / "zoo_configs" / "bruno_sac.yml").read_text())["CheetahDir-v0"]
    assert {key: config[key] for key in quickstart.HYPERPARAMETERS if key not in shorter} == {
        key: value for key, value in quickstart.HYPERPARAMETERS.items() if key not in shorter
    }
    defaults = {"policy": "MlpPolicy", "buffer_size": 1_000_000, "train_freq": 1}
    defaults |= {"gamma": 0.99, "tau": 0.005, "encoder_batch_size": 16}
    given = {"n_envs", "n_timesteps", *shorter, *quickstart.HYPERPARAMETERS}
    assert {key: value for key, value in config.items() if key not in given} == defaults


@pytest.mark.parametrize(
    ("module", "names"),
    {
        "sb3_bruno": "BrunoSAC BrunoTQC BrunoCrossQ BrunoTD3 BrunoEncoder TaskEncoder TaskReplayBuffer Transitions",
        "sb3_bruno.buffers": "TaskReplayBuffer",
        "sb3_bruno.diagnostics": "diagnose Diagnostics",
        "sb3_bruno.encoders": "BrunoEncoder TaskEncoder Transitions Outcomes",
        "sb3_bruno.export": "Controller export_agent load_agent register_agent_class save_agent",
        "sb3_bruno.evaluation": "evaluate_adaptation AdaptationResult library_versions",
        "sb3_bruno.plotting": "plot_adaptation plot_learning_curves",
        "sb3_bruno.resume": "ResumeCallback resume save_checkpoint",
        "sb3_bruno.zoo.registry": "register",
    }.items(),
)
def test_documented_imports_keep_working(module, names):
    assert all(hasattr(importlib.import_module(module), name) for name in names.split())
