"""``python -m pipeline.cli``."""

import sys

if __name__ == "__main__":
    from pipeline.cli.app import main

    sys.exit(main())
