"""Trained agents are packed, pushed to a hub and pulled from it; nothing but an agent's own files comes in."""

import shutil
from collections import OrderedDict

import huggingface_hub
import pytest
import yaml

from sb3_bruno.cli.main import main
from sb3_bruno.evaluation import AdaptationResult
from sb3_bruno.export import load_agent
from sb3_bruno.zoo.saved_yaml import read_saved
from support.fake_hub import TOKEN, fake_hub
from support.tiny_runs import tiny

ENV = ["--env", "PointDir-v0"]
PUSH, PULL = ["push", *ENV, "--repo-id", "me/point-dir"], ["pull", "--repo-id", "me/point-dir"]
PACKED = "agents/bruno_sac/PointDir-v0_1"
FILES = {
    "PointDir-v0.agent",
    "PointDir-v0/args.yml",
    "PointDir-v0/config.yml",
    "README.md",
    "adaptation.png",
    "diagnostics.txt",
    "sb3_bruno_origin.json",
}


def files_of(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def note_a_path(config, path):
    """Let a run's settings name a file of the machine, as those of a user's own classes may."""
    settings = OrderedDict(read_saved(config), policy_kwargs={"weights": str(path)})
    config.write_text(yaml.dump(settings))


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A folder with a run that was tested and diagnosed, and its agent packed in ``agents``."""
    folder = tmp_path_factory.mktemp("trained")
    logs = ["-f", str(folder / "logs")]
    main([*map(str, tiny(*logs, "--eval-freq", 32, steps=64)), "normalize:True"])
    note_a_path(folder / "logs/bruno_sac/PointDir-v0_1/PointDir-v0/config.yml", folder / "secret" / "weights.pt")
    main(["evaluate", *ENV, *logs, "--episodes", "2"])
    main(["diagnose", *ENV, *logs, "--episodes", "1"])
    main(["pack", *ENV, *logs, "--out", str(folder / "agents")])
    return folder


@pytest.fixture
def here(trained, tmp_path):
    """A copy of that folder, which is the current one."""
    shutil.copytree(trained, tmp_path, dirs_exist_ok=True)
    return tmp_path


@pytest.fixture
def hub(monkeypatch, tmp_path):
    """A hub, to which somebody is logged in."""
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    with fake_hub() as served:
        monkeypatch.setattr(huggingface_hub.constants, "ENDPOINT", served.address)
        template = served.address + "/{repo_id}/resolve/{revision}/{filename}"
        monkeypatch.setattr(huggingface_hub.constants, "HUGGINGFACE_CO_URL_TEMPLATE", template)
        yield served


@pytest.fixture
def pushed(hub, trained):
    """A hub with that agent on it."""
    hub.repositories["me/point-dir"] = files_of(trained / PACKED) | {".gitattributes": b"* text=auto"}
    return hub.repositories["me/point-dir"]


def test_a_packed_agent_is_watched_like_any_other(run, here):
    assert set(files_of(here / PACKED)) == FILES
    assert "Mean reward" in run("enjoy", *ENV, "-f", "agents", "--no-render", "-n", 31)[0]
    assert load_agent(here / PACKED / "PointDir-v0.agent").get_vec_normalize_env() is not None
    assert run("pack", *ENV)[0].splitlines()[-1] == "Saved agents/bruno_sac/PointDir-v0_2"


def test_its_card_tells_what_was_measured(here):
    card = (here / PACKED / "README.md").read_text()
    result = AdaptationResult.load(here / "logs/bruno_sac/PointDir-v0_1/adaptation.json")
    for line in (
        "tags:\n- sb3_bruno\n",
        "- PointDir-v0\n---\n\n# bruno_sac",
        "`BrunoSAC` of sb3_bruno, trained for 64 env steps, seed 1.",
        "| test tasks | return of 30 steps |",
        "Means over 2 episodes of each task, with the most likely actions.",
        "![Reward in an episode](adaptation.png)",
        "## How far its belief can be trusted",
        "sb3-bruno train --algo bruno_sac",
        "Trained at commit ",
        "Tested with python 3",
    ):
        assert line in card
    rows = [line.split(" | ") for line in card.splitlines() if line.startswith(("| left", "| right"))]
    assert [row[1].strip(" |") for row in rows] == [f"{mean:.1f}" for mean in result.returns(30).mean(axis=1)]


def test_where_it_was_made_stays_at_home(trained):
    packed = files_of(trained / PACKED)
    assert str(trained).encode() in (trained / "logs/bruno_sac/PointDir-v0_1/sb3_bruno_origin.json").read_bytes()
    assert not [name for name, content in packed.items() if str(trained).encode() in content]
    assert read_saved(trained / PACKED / "PointDir-v0" / "args.yml")["log_folder"] == "logs"
    assert b" -f logs " in packed["README.md"]
    assert b" policy_kwargs.weights=weights.pt," in packed["README.md"]
    assert read_saved(trained / PACKED / "PointDir-v0" / "config.yml")["policy_kwargs"] == {"weights": "weights.pt"}


def test_pushed_and_pulled_it_is_the_same(run, here, hub):
    expected = files_of(here / PACKED)
    assert "Sent agents/bruno_sac/PointDir-v0_1 to http" in run(*PUSH)[0]
    assert hub.repositories["me/point-dir"] == expected
    shutil.rmtree(here / "agents")
    printed, mistake = run(*PULL)
    assert mistake == "" and "sb3-bruno enjoy -f agents --algo bruno_sac --env PointDir-v0" in printed
    assert files_of(here / PACKED) == expected
    assert "Mean reward" in run("enjoy", *ENV, "-f", "agents", "--no-render", "-n", 31)[0]


def test_what_lies_beside_it_is_not_pushed(run, here, hub):
    (here / PACKED / "PointDir-v0.zip").write_bytes(b"a pickle")
    (here / PACKED / "notes.txt").write_text("mine alone")
    assert run(*PUSH)[1] == ""
    assert set(hub.repositories["me/point-dir"]) == FILES


def with_file(name, content):
    return lambda files: files.update({name: content})


def without(name):
    return lambda files: files.pop(name)


def with_settings(file, entries):
    def change(files, folder):
        path = folder / "settings.yml"
        path.write_bytes(files[f"PointDir-v0/{file}"])
        files[f"PointDir-v0/{file}"] = yaml.dump({**read_saved(path), **entries}).encode()
        path.unlink()

    return change


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (with_file("PointDir-v0.zip", b"PK"), "holds 'PointDir-v0.zip', which is no file of an agent"),
        (with_file("PointDir-v0/vecnormalize.pkl", b""), "which is no file of an agent"),
        (with_file("../../.bashrc", b""), "holds '../../.bashrc', which is no file of an agent"),
        (with_file("/etc/passwd", b""), "holds '/etc/passwd', which is no file of an agent"),
        (with_file("More-v0.agent", b""), "holds 2 agent files"),
        (without("PointDir-v0.agent"), "holds 0 agent files"),
        (without("PointDir-v0/args.yml"), "lacks PointDir-v0/args.yml"),
        (without("README.md"), "lacks README.md"),
        (with_file("PointDir-v0.agent", b"\x80\x04."), "cannot be loaded as an agent"),
        (with_file("PointDir-v0/config.yml", b"a: !!python/object/apply:os.system [ls]"), "cannot be read"),
        (
            with_settings("args.yml", {"algo": "pearl_sac"}),
            "PointDir-v0.agent holds a BrunoSAC, and PointDir-v0/args.yml says algo 'pearl_sac'",
        ),
        (with_settings("args.yml", {"algo": "../.."}), "says algo '../..'"),
        (with_settings("args.yml", {"algo": ["bruno_sac"]}), "args.yml cannot be read: its algo is ['bruno_sac']"),
        (
            with_settings("args.yml", {"env_kwargs": 5}),
            "point-dir: PointDir-v0/args.yml cannot be read: its env",
        ),
        (with_settings("args.yml", {"env_kwargs": {"max_episode_steps": 10**12}}), "asks for 'max_episode_steps'="),
        (with_settings("args.yml", {"gym_packages": ["antigravity"]}), "asks for the package 'antigravity'"),
        (with_settings("config.yml", {"env_wrapper": "sb3_bruno_envs.Nope"}), "the wrapper 'sb3_bruno_envs.Nope'"),
        (
            with_file("sb3_bruno_origin.json", b'{"command": [[]]}'),
            "json does not tell the command that started the",
        ),
        (with_settings("config.yml", {"env_wrapper": "os.system"}), "asks for the wrapper 'os.system'"),
        (with_settings("config.yml", {"normalize": "exit()"}), "asks for the expression"),
    ],
)
def test_nothing_else_is_pulled(run, pushed, tmp_path, change, line):
    change(pushed, tmp_path) if change.__name__ == "change" else change(pushed)
    mistake = run(*PULL)[1]
    assert mistake.startswith("sb3-bruno pull: ") and line in mistake and "\n" not in mistake
    assert not list(tmp_path.iterdir())


def test_a_wrapper_of_a_package_that_both_sides_name_is_shared(run, here, hub):
    path = here / PACKED / "PointDir-v0" / "config.yml"
    path.write_text(yaml.dump({**read_saved(path), "env_wrapper": "gymnasium.wrappers.Autoreset"}))
    for command in (PUSH, PULL):
        mistake = run(*command)[1]
        assert "asks for the wrapper 'gymnasium.wrappers.Autoreset', which is not ours: give --gym-packages" in mistake
        assert "--trust" not in mistake
        printed, mistake = run(*command, "--gym-packages", "gymnasium")
        assert mistake == ""
    assert "enjoy -f agents --algo bruno_sac --env gymnasium:PointDir-v0" in printed


@pytest.mark.parametrize(("env", "told"), [("Point/Dir-v0", "Point/Dir-v0"), ("other:Point-Dir-v0", "Point-Dir-v0")])
def test_the_line_that_watches_it_names_the_environment_by_its_id_with_slashes(run, here, hub, env, told):
    path = here / PACKED / "PointDir-v0" / "args.yml"
    path.write_text(yaml.dump({**read_saved(path), "env": env}))
    assert run("push", *renamed(here, "Point-Dir-v0"))[1] == ""
    printed, mistake = run(*PULL, "--out", "the agents")
    assert mistake == "" and f"enjoy -f 'the agents' --algo bruno_sac --env {told}\n" in printed


def renamed(folder, env):
    """Give the environment of the packed agent another name; return what commands call it by."""
    packed = folder / PACKED
    for path in sorted(packed.glob("PointDir-v0*")):
        path.rename(packed / path.name.replace("PointDir-v0", env))
    packed.rename(packed.parent / f"{env}_1")
    return [f"--env={env}", "--repo-id", "me/point-dir"]


def test_a_name_with_a_dot_is_pushed_and_pulled(run, here, hub):
    assert run("push", *renamed(here, "Point.Dir-v0"))[1] == ""
    shutil.rmtree(here / "agents")
    assert run(*PULL)[1] == ""
    assert (here / "agents" / "bruno_sac" / "Point.Dir-v0_1" / "Point.Dir-v0.agent").is_file()


@pytest.mark.parametrize("name", ["Point Dir-v0", "-rf", "Pünkt-v0"])
def test_what_pull_would_refuse_by_its_name_is_not_pushed(run, here, hub, name):
    mistake = run("push", *renamed(here, name))[1]
    assert f"an agent of {name!r}, which cannot be shared by that name: register" in mistake and "\n" not in mistake
    assert hub.repositories == {}


@pytest.mark.parametrize(
    ("file", "text", "line"),
    [
        ("PointDir-v0/args.yml", "a: 1", "args.yml cannot be read"),
        ("PointDir-v0.agent", "", "PointDir-v0.agent' cannot be loaded as an agent"),
        ("sb3_bruno_origin.json", "{}", "does not tell the command"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*cannot be read")
def test_what_pull_would_refuse_is_not_pushed(run, here, hub, file, text, line):
    (here / PACKED / file).write_text(text)
    mistake = run(*PUSH)[1]
    assert line in mistake and "\n" not in mistake
    assert hub.repositories == {}


def test_a_file_that_is_too_large_is_not_fetched(run, hub, pushed, tmp_path):
    hub.sizes["README.md"] = 10**12
    assert "README.md has 1000000000000 bytes" in run(*PULL)[1]
    assert not list(tmp_path.iterdir())


def test_a_repository_that_is_not_there_is_told(run, hub):
    mistake = run(*PULL)[1]
    assert "the hub has no such repository, or does not show it to you" in mistake and "\n" not in mistake


def test_who_is_not_logged_in_or_not_let_in_is_told(run, here, hub, monkeypatch):
    monkeypatch.setenv("HF_TOKEN", "hf_bad")
    mistake = run(*PUSH)[1]
    assert "sb3-bruno push: --repo-id me/point-dir: the hub" in mistake and "\n" not in mistake
    monkeypatch.delenv("HF_TOKEN")
    monkeypatch.setattr("sb3_bruno.export.hub.get_token", lambda: None)
    assert "nobody is logged in to the hub: log in by `hf auth login`" in run(*PUSH)[1]


@pytest.mark.parametrize("command", [PUSH, PULL], ids=["push", "pull"])
def test_a_hub_that_does_not_answer_is_told(run, here, monkeypatch, command):
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    monkeypatch.setattr(huggingface_hub.constants, "ENDPOINT", "http://127.0.0.1:9")
    mistake = run(*command)[1]
    assert "cannot be reached" in mistake and "\n" not in mistake


def test_a_name_that_is_none_is_told(run, here, hub):
    mistake = run("pull", "--repo-id", "../up")[1]
    assert "--repo-id ../up" in mistake and "\n" not in mistake


def test_what_was_not_packed_or_not_tested_is_told(run, here, hub):
    assert "make such a folder from a run by `sb3-bruno pack`" in run(*PUSH, "-f", "logs")[1]
    for path in (here / "logs").rglob("adaptation*.json"):
        path.unlink()
    mistake = run("pack", *ENV)[1]
    assert "test the run by `sb3-bruno evaluate` first" in mistake
    assert not (here / "agents" / "bruno_sac" / "PointDir-v0_2").exists()
