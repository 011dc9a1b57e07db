"""`python -m app` is `thermap`."""

from app.cli import main

if __name__ == "__main__":
    main()
