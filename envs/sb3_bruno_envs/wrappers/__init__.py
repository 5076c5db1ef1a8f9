"""Wrappers that give an environment tasks, trials and what an agent sees of them; know no environment."""
