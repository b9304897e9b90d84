"""So that Python runs the folder."""

import sys

from mbot_update.main import main

sys.exit(main())
