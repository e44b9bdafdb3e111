"""What the development of the project needs, and no installation has."""
