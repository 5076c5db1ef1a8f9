"""``sb3-bruno live``: a page in the browser, on which an agent acts while one changes its hidden task."""

from __future__ import annotations

from sb3_bruno.cli.mistake import check_installed, told_as_mistake
from sb3_bruno.cli.parser import add_gym_packages, add_run, add_trust, command_parser
from sb3_bruno.cli.values import seed, whole_number

LARGEST_PORT = 65_535


def live(arguments: list[str]) -> None:
    """Watch a trained agent in the browser, and change its hidden task while it acts.

    The page can be seen on this machine only, unless --host says otherwise.

    example: sb3-bruno live --algo bruno_sac --env CheetahDir-v0 -f agents
    """
    parser = command_parser("live", live)
    add_run(parser, folder="logs")
    add_gym_packages(parser)
    add_trust(parser)
    parser.add_argument("--host", default="127.0.0.1", help="address to listen at (default: 127.0.0.1, this machine)")
    parser.add_argument(
        "--port", type=whole_number(1, LARGEST_PORT), default=8080, help="the next free one is taken (default: 8080)"
    )
    parser.add_argument("--seed", type=seed, default=0, help="of the environment (default: 0)")
    options = parser.parse_args(arguments)
    check_installed("viser", extra="live")

    import torch as th

    from sb3_bruno.live.agents import choose_agent, find_agents, open_agent
    from sb3_bruno.live.page import Page
    from sb3_bruno.zoo.registry import register

    th.set_num_threads(1)
    register()
    package, _, env = options.env.rpartition(":")
    packages = [*options.gym_packages, *([package] if package else [])]
    with told_as_mistake():
        chosen = choose_agent(options.algo, env, options.folder, options.exp_id)
        agents = {str(agent): agent for agent in (chosen, *find_agents(options.folder))}
        page = Page(
            list(agents),
            lambda name: open_agent(agents[name], options.folder, packages, seed=options.seed, trust=options.trust),
            str(chosen),
            host=options.host,
            port=options.port,
        )
        print(f"Open {page.url} in a browser. Ctrl-C ends it.", flush=True)
        page.run()
