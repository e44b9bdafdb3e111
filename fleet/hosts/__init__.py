"""A fleet over several hosts: the hosts file, and what starts each role there. Pure, no network."""
