"""A fleet of UAV processes over zenoh, for the study of cooperative collision avoidance."""

__version__ = "0.1.0"
