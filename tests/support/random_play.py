"""Episodes of seeded random actions."""


def rewards(env, seed=0):
    """The rewards of one episode of seeded random actions."""
    env.reset(seed=seed)
    env.action_space.seed(seed)
    episode, done = [], False
    while not done:
        _, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        episode.append(reward)
        done = terminated or truncated
    return episode
