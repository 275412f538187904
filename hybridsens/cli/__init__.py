"""The command line: its commands are registered in `main.py`."""
