"""``python -m thermofem`` is the command ``thermofem``."""

from .cli import main

if __name__ == "__main__":
    main()
