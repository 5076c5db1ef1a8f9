"""Holds the environments that need NumPy alone and are learned in seconds to minutes; knows no MuJoCo."""
