"""``python -m studies NAME``: see ``studies.compare``."""

import sys

from studies.compare import main

if __name__ == "__main__":
    sys.exit(main())
