"""`python -m hybridsens`, where the folder of the console script is not on the path."""

from .cli.main import main

if __name__ == "__main__":
    main()
