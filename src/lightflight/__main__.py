"""Let `python -m lightflight` do what `lightflight` does."""

from lightflight.cli import main

if __name__ == "__main__":
    main(prog_name="lightflight")
