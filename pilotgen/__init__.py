"""Which pilot makes this helicopter bounce? From biometrics to biodynamic feedthrough to stability margins.

SPDX-License-Identifier: BSD-3-Clause
"""

__version__ = "1.0.0"
