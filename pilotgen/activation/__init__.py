"""Muscle activations at minimum effort, and the gains of the stretch reflex.

SPDX-License-Identifier: BSD-3-Clause
"""
