"""`python -m fleet`."""

from fleet.entry import start

if __name__ == "__main__":
    start()
