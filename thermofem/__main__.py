"""``python -m thermofem``: the command ``thermofem``."""

from thermofem_cli import main

if __name__ == "__main__":
    main()
