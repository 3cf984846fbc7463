"""Where the pilot sits and how he holds the controls: cockpit, arm kinematics, joint angles.

SPDX-License-Identifier: BSD-3-Clause
"""
