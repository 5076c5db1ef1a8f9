"""Holds the wrappers that give an environment tasks, trials and observations; knows no environment."""
