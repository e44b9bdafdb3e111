"""Measurements that the documentation quotes; each is a command that anyone can run."""
