"""`python -m pilotgen`.

SPDX-License-Identifier: BSD-3-Clause
"""

import sys

from pilotgen.cli import main

sys.exit(main())
