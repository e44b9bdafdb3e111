"""`python -m fleet`."""

from fleet.entry import main

if __name__ == "__main__":
    main()
