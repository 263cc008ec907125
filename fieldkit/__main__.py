"""``python -m fieldkit`` is ``fieldkit``."""

from fieldkit.commands import main

if __name__ == "__main__":
    main(prog_name="fieldkit")
