// Reads decks: a file or a text in, a Deck or diagnostics out. Never throws on bad input.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mbdae/deck/deck.h"

namespace mbdae {

enum class Severity { error, warning };

/// One message about the input: what came, what was expected, where.
struct Diagnostic {
  std::string file;
  int line = 0;    ///< from 1; 0 = the file as a whole
  int column = 0;  ///< from 1
  Severity severity = Severity::error;
  std::string message;

  /// `file:line:column: error: message`
  std::string format() const;
};

struct ReadResult {
  std::optional<Deck> deck;  ///< present only without errors
  std::vector<Diagnostic> diagnostics;
};

/// Reads a deck and the files it includes; `elements` are those it may have (elements/table.h).
ReadResult read_deck_file(const std::string& path, ElementTable elements);

/// Reads a deck from memory; `name` is used in messages and its directory for relative includes.
ReadResult read_deck_text(const std::string& text, const std::string& name, ElementTable elements);

}  // namespace mbdae
