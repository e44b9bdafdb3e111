"""Publishing a log on zenoh again, in its timing."""
