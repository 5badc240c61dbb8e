"""``python -m patchtransfer.reproduce``."""

from . import main

if __name__ == "__main__":
    main()
