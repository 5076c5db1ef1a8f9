"""All trained agents of a folder are found, and each acts in an environment that can be looked at."""

from functools import partial
from pathlib import Path

import gymnasium as gym
import pytest
from gymnasium.wrappers import TimeLimit

import sb3_bruno_envs
from sb3_bruno.cli.main import main
from sb3_bruno.live import page as live_page
from sb3_bruno.live.agents import Agent, choose_agent, find_agents, make_shown, open_agent
from sb3_bruno.live.robot import is_robot
from sb3_bruno.zoo.registry import register
from sb3_bruno_envs import PointDirEnv
from support.tiny_runs import tiny

AGENTS = Path(__file__).parents[2] / "agents"
SHIPPED = Agent("bruno_sac", "CheetahDir-v0", 1)


def time_limits(env):
    """The time limits around an environment."""
    found = []
    while isinstance(env, gym.Wrapper):
        found += [env] if isinstance(env, TimeLimit) else []
        env = env.env
    return found


def test_the_agents_of_a_folder_are_found_by_name(tmp_path):
    register()
    for name in (
        "bruno_sac/PointDir-v0_2/PointDir-v0.zip",
        "bruno_sac/PointDir-v0_1/PointDir-v0.zip",
        "sac/Old_Name-v0_10/Old_Name-v0.zip",
        "bruno_sac/PointDir-v0_3/PointDir-v0/config.yml",  # of a training that saved no agent yet
        "unknown/PointDir-v0_1/PointDir-v0.zip",
        "bruno_sac/PointDir-v0_best/PointDir-v0.zip",
        "bruno_sac/notes.txt",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    found = find_agents(tmp_path)
    assert found == [("bruno_sac", "PointDir-v0", 1), ("bruno_sac", "PointDir-v0", 2), ("sac", "Old_Name-v0", 10)]
    assert len(set(map(str, found))) == 3
    assert choose_agent("bruno_sac", "PointDir-v0", tmp_path) == ("bruno_sac", "PointDir-v0", 2)
    assert choose_agent("bruno_sac", "PointDir-v0", tmp_path, 1) == ("bruno_sac", "PointDir-v0", 1)
    assert find_agents(tmp_path / "nothing") == []


@pytest.mark.mujoco
def test_a_robot_has_no_time_limit():
    assert sb3_bruno_envs
    env = make_shown(partial(gym.make, "CheetahDir-v0"))
    assert is_robot(env) and time_limits(env) == []


def test_what_paints_itself_paints_and_keeps_its_time_limit():
    env = make_shown(partial(gym.make, "PointDir-v0"))
    assert env.render_mode == "rgb_array" and len(time_limits(env)) == 1


class Unpainted(PointDirEnv):
    """Paints nothing."""

    metadata = {"render_modes": []}  # noqa: RUF012  # as Gymnasium has it


@pytest.mark.parametrize("maker", [PointDirEnv, Unpainted])
def test_what_cannot_be_made_to_paint_is_left_as_it_is(maker):
    env = make_shown(lambda: maker())
    assert env.render_mode is None and not is_robot(env)


@pytest.mark.mujoco
def test_the_agents_that_come_with_the_repository_act():
    register()
    assert SHIPPED in find_agents(AGENTS)
    session = open_agent(SHIPPED, AGENTS)
    session.set_task([0.0, 1.0])
    forward = [session.step() for _ in range(40)][-1]
    session.set_task([1.0, 0.0])
    backward = [session.step() for _ in range(40)]
    assert forward.task_name == "forward" and forward.reward > 2.0
    assert max(moment.surprise for moment in backward[:20]) > session.forget_threshold
    assert backward[-1].task_name == "backward" and backward[-1].reward > backward[0].reward + 1.0


class Page:
    """Stands in for the page, and opens its agent."""

    url = "http://host:1"

    def __init__(self, agents, open_session, chosen, **address):
        Page.made = (agents, chosen, address)
        self.session = open_session(chosen)

    def run(self):
        Page.ran = self.session


@pytest.mark.mujoco
def test_the_command_opens_the_page_of_the_agent_that_the_flags_choose(run, monkeypatch):
    monkeypatch.setattr(live_page, "Page", Page)
    printed, mistake = run("live", "-f", AGENTS, "--env", "CheetahVel-v0", "--host", "0.0.0.0", "--port", "81")
    assert mistake == "" and "Open http://host:1 in a browser" in printed
    agents, chosen, address = Page.made
    assert (chosen, address) == ("bruno_sac  CheetahVel-v0  1", {"host": "0.0.0.0", "port": 81})
    assert agents[0] == chosen and str(SHIPPED) in agents and len(set(agents)) == len(agents)
    assert Page.ran.env.spec.id == "CheetahVel-v0"
    run("live", "-f", AGENTS)
    assert Page.made[1:] == (str(SHIPPED), {"host": "127.0.0.1", "port": 8080})


@pytest.mark.parametrize(
    ("flags", "part"),
    [
        (["--port", "0"], "--port: '0' is not a whole number from 1 to 65535"),
        (["--env", "PointDir-v0"], "train there, or give another -f, --algo, --env or --exp-id"),
        (["--algo", "bruno_sak"], "did you mean bruno_sac?"),
        (["--env", "nothing_here:PointDir-v0"], "--gym-packages nothing_here cannot be imported"),
        (["--prot", "81"], "did you mean --port?"),
    ],
)
def test_a_mistake_is_told_in_one_line(tmp_path, monkeypatch, capsys, flags, part):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        main(["live", *flags])
    line = capsys.readouterr().err.strip() if end.value.code == 2 else str(end.value.code)
    assert line.startswith("sb3-bruno live: ") and part in line and "\n" not in line


def test_a_missing_library_is_named_with_its_extra(run, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert run("live")[1] == "sb3-bruno live: viser is not installed: pip install 'sb3_bruno[live]'"


def test_a_pickle_from_elsewhere_is_opened_only_if_it_is_trusted(run, tmp_path):
    assert run(*tiny("--eval-freq", -1, algo="recurrent_sac", env="PointDir-v0", steps=8))[1] == ""
    run_folder = tmp_path / "logs" / "recurrent_sac" / "PointDir-v0_1"
    for safe in run_folder.glob("*.agent"):
        safe.unlink()
    (tmp_path / "logs").rename(tmp_path / "found")
    agent = Agent("recurrent_sac", "PointDir-v0", 1)
    with pytest.raises(ValueError, match="--trust"):
        open_agent(agent, tmp_path / "found")
    assert open_agent(agent, tmp_path / "found", trust=True).step().step == 1
    assert "--trust" in run("live", "-f", "found", "--algo", "recurrent_sac", "--env", "PointDir-v0")[1]


def test_an_env_of_endless_tasks_can_be_opened(run, tmp_path, monkeypatch):
    """Such an environment has no list of tasks, so no other command tests its agent."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "endless_envs.py").write_text(
        "import gymnasium as gym, numpy as np\n"
        "from gymnasium.spaces import Box\n"
        "from sb3_bruno_envs import MetaTask, WindEnv, TaskSampler, TransitionObservation\n"
        "TASKS = TaskSampler(lambda rng: rng.uniform(-1.0, 1.0, 2), Box(-1.0, 1.0, (2,)))\n"
        "def make(render_mode=None):\n"
        "    env = MetaTask(WindEnv(render_mode), WindEnv.set_task, TASKS)\n"
        "    return TransitionObservation(env)\n"
        "gym.register('Endless-v0', make, max_episode_steps=10)\n"
    )
    flags = ["--gym-packages", "endless_envs", "--eval-freq", -1]
    assert run(*tiny(*flags, algo="recurrent_sac", env="Endless-v0", steps=8))[1] == ""
    session = open_agent(Agent("recurrent_sac", "Endless-v0", 1), "logs")
    session.set_task([0.25, -0.5])
    assert session.step().task.tolist() == [0.25, -0.5] and session.env.render_mode == "rgb_array"
    session.draw_task()
    assert session.task.tolist() != [0.25, -0.5]
