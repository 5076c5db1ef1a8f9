"""A visitor opens the page in a real browser, changes the hidden task, and sees the agent notice."""

import re
import threading
from contextlib import contextmanager

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from sb3_bruno.cli.main import main
from sb3_bruno.live.agents import find_agents, open_agent
from sb3_bruno.live.page import Page
from support.browser import browser, click, text_of, wait_for

TRAINED = [  # in ten seconds, so that the read-out follows a switch
    "policy_kwargs:dict(net_arch=[32])",
    "encoder_kwargs:dict(net_arch=(32,), n_weights=8, modelled='rewards')",
    "replay_buffer_kwargs:dict(n_sequences=8, sequence_length=16)",
    *("learning_starts:200", "encoder_learning_starts:100", "encoder_update_ratio:0.5", "encoder_batch_size:8"),
    *("batch_size:64", "gradient_steps:2", "gamma:0.9", "tau:0.02", "n_envs:4"),
    *("learning_rate:3e-3", "encoder_learning_rate:3e-3"),
]
TINY = ["policy_kwargs:dict(net_arch=[8])", "learning_starts:1000", "n_envs:1"]
OWN = """
import gymnasium as gym
from gymnasium.spaces import Box
from sb3_bruno_envs import MetaTask, PointDirEnv, TaskSampler, TransitionObservation


class Unpainted(PointDirEnv):
    metadata = {"render_modes": []}

    def set_task(self, task):
        if task[0] > 0.5:
            raise ValueError("it is too hot for a task above 0.5")
        self.direction[0] = task[0]


HEAT = TaskSampler(lambda rng: rng.uniform(0.0, 0.5, 1), Box(0.0, 1.0, (1,)))


def make():
    return TransitionObservation(MetaTask(Unpainted(), Unpainted.set_task, HEAT, task_entries=[("heat", "K")]))


gym.register("Own-v0", make, max_episode_steps=10)
"""


def train(folder, algo, env, steps, params, *flags):
    chosen = ["--algo", algo, "--env", env, "-n", str(steps), "--seed", "0", "--eval-freq", "-1", "-f", str(folder)]
    main(["train", *chosen, *flags, "-params", *params])


@pytest.fixture
def logs(tmp_path, monkeypatch):
    """A log folder beside a package with somebody's own environment."""
    (tmp_path / "hot_envs.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path / "logs"


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("profile")) as driver:
        yield driver


class Visit:
    """A page, the browser on it, and all steps that the agent takes meanwhile."""

    def __init__(self, driver, page):
        self.driver, self.page, self.moments = driver, page, []

    def says(self, pattern):
        return re.search(pattern, text_of(self.driver))

    def wait(self, pattern):
        wait_for(self.driver, lambda: self.says(pattern))

    def click(self, label):
        click(self.driver, label)

    def record(self):
        """Keep every step of the session that is shown."""
        session, step = self.page.session, self.page.session.step
        session.step = lambda: self.moments.append(step()) or self.moments[-1]


@contextmanager
def visited(driver, logs):
    """The page of the first agent of a folder, in the browser."""
    agents = {str(agent): agent for agent in find_agents(logs)}
    page = Page(list(agents), lambda name: open_agent(agents[name], logs), next(iter(agents)), port=8321)
    visit = Visit(driver, page)
    visit.record()
    thread = threading.Thread(target=page.run)
    thread.start()
    try:
        driver.get(page.url)
        visit.wait(r"step [1-9]")
        yield visit
    finally:
        page.end()
        thread.join()


@pytest.mark.slow
def test_a_click_changes_the_task_and_the_read_out_follows(driver, logs):
    train(logs, "bruno_sac", "PointDir-v0", 1_000, TRAINED)
    with visited(driver, logs) as visit:
        assert visit.page.url.startswith("http://127.0.0.1:")
        assert driver.find_elements(By.CSS_SELECTOR, "canvas")
        for name, other in (("left", "right"), ("right", "left"), ("left", "right")):
            n_before = len(visit.moments)
            visit.click(name)
            likely, unlikely = rf"{name} (1\.00|0\.[5-9]\d) ◂ true", rf"{other} 0\.[0-4]\d"
            visit.wait(rf"{likely}\n{unlikely}|{unlikely}\n{likely}")
            moments = [moment for moment in visit.moments[n_before:] if moment.task_name == name]
            place = moments[0].estimate.labels.tasks.index(name)
            assert max(moment.estimate.probabilities[0, place] for moment in moments[:20]) > 0.5


@pytest.mark.slow
def test_a_visitor_pauses_the_agent_slows_it_down_and_begins_anew(driver, logs):
    train(logs, "bruno_sac", "PointDir-v0", 8, TINY)
    with visited(driver, logs) as visit:
        visit.click("Pause")
        visit.wait("Go on")
        n_steps = len(visit.moments)
        visit.click("New episode")
        visit.wait(r"step 0, return 0\.0")
        assert len(visit.moments) == n_steps and visit.page.session.is_paused
        visit.click("Go on")
        visit.wait("Pause")
        visit.wait(r"step [1-9]")
        assert visit.moments[n_steps].step == 1
        for box in driver.find_elements(By.CSS_SELECTOR, "input[type=checkbox]"):
            driver.execute_script("arguments[0].click()", box)
        wait_for(driver, lambda: not visit.page.session.deterministic)
        wait_for(driver, lambda: visit.page.session.forget_threshold is None)
        put(driver, "Speed", 0.5)
        wait_for(driver, lambda: visit.page.session.seconds_per_step == pytest.approx(0.2))


def put(driver, label, value):
    """Write a number into the field beside a slider."""
    xpath = f"//label[normalize-space()='{label}']/ancestor::*[.//input[@type='text']][1]//input[@type='text']"
    field = driver.find_element(By.XPATH, xpath)
    field.send_keys(Keys.CONTROL + "a")
    field.send_keys(str(value), Keys.ENTER)


@pytest.mark.mujoco
@pytest.mark.slow
def test_a_robot_moves_in_3d_and_its_task_by_a_slider(driver, logs):
    train(logs, "recurrent_sac", "CheetahVel-v0", 8, TINY)
    with visited(driver, logs) as visit:
        put(driver, "velocity (m/s)", 2.5)
        visit.wait(r"Hidden task: 2\.5 m/s")
        visit.wait(r"velocity .* true 2\.5|true 2\.5")
        assert visit.page.session.env.unwrapped.velocity == 2.5


@pytest.mark.slow
def test_somebodys_own_env_is_shown_by_charts_alone_and_what_it_refuses_is_told(driver, logs):
    train(logs, "recurrent_sac", "Own-v0", 8, TINY, "--gym-packages", "hot_envs")
    with visited(driver, logs) as visit:
        put(driver, "heat (K)", 0.25)
        visit.wait("Hidden task: 0.25")
        put(driver, "heat (K)", 0.75)
        visit.wait("This cannot be done\nit is too hot for a task above 0.5")
        assert visit.page.session.task.tolist() == [0.0]  # the first digit that was typed
        visit.click("Draw a test task")
        wait_for(driver, lambda: visit.page.session.task.tolist() != [0.0])


@pytest.mark.slow
def test_another_agent_is_picked_from_the_list(driver, logs):
    train(logs, "bruno_sac", "PointDir-v0", 8, TINY)
    train(logs, "recurrent_sac", "PointGoal-v0", 8, TINY)
    with visited(driver, logs) as visit:
        driver.find_element(By.XPATH, "//input[@value='bruno_sac  PointDir-v0  1']").click()
        option = "//*[@role='option'][normalize-space()='recurrent_sac PointGoal-v0 1']"
        wait_for(driver, lambda: driver.find_elements(By.XPATH, option))
        driver.execute_script("arguments[0].click()", driver.find_element(By.XPATH, option))
        visit.wait(r"goal x")
        visit.wait(r"step [1-9]")
        assert visit.page.session.env.spec.id == "PointGoal-v0"
