"""Environments in NumPy alone, learned in seconds to minutes; know no MuJoCo."""
