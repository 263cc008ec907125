"""``python -m fieldkit`` is ``fieldkit``."""

from fieldkit.cli import main

if __name__ == "__main__":
    main(prog_name="fieldkit")
