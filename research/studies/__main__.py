"""``python -m research.studies NAME``: see ``research.studies.compare``."""

import sys

from research.studies.compare import main

if __name__ == "__main__":
    sys.exit(main())
