"""The decks of one pilot, rendered from templates/.

SPDX-License-Identifier: BSD-3-Clause
"""
