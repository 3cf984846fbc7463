// Collects what there is to say about the input, and helps to say it well.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "mbdae/deck/deck.h"
#include "mbdae/deck/reader.h"

namespace mbdae::reading {

/// Thrown once a message has been recorded (or when the cause has been reported before); caught at the card.
struct Reported {};

/// A list of words the language knows at some place, written with their blanks: {"revolute hinge", ...}.
using Choices = std::span<const char* const>;

/// The messages of one reading, at most `kLimit` errors and as many warnings.
class Diagnostics {
 public:
  static constexpr std::size_t kLimit = 50;

  /// Registers a file name; a name known already keeps its index.
  int add_file(const std::string& name);
  const std::vector<std::string>& files() const { return files_; }

  void error(const SourcePosition& where, std::string message);
  void warning(const SourcePosition& where, std::string message);
  [[noreturn]] void fail(const SourcePosition& where, std::string message);

  bool full() const { return full_; }
  bool has_errors() const { return error_count_ > 0; }
  std::vector<Diagnostic> take() { return std::move(list_); }

 private:
  void add(const SourcePosition& where, Severity severity, std::string message);

  std::vector<std::string> files_;
  std::vector<Diagnostic> list_;
  std::size_t error_count_ = 0;
  std::size_t warning_count_ = 0;
  bool full_ = false;
};

/// Text from the input between back quotes: printable, at most 40 characters.
std::string quoted(std::string_view text);

/// A number as short as reading it back allows.
std::string number_text(double value);

inline char lower(char c) { return static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c); }

/// The rest of `same_words`, for words that begin alike.
bool same_spelling(std::string_view words, const char* display);

/// `words` (lower case, no blanks) is the keyword `display` (which may have blanks, but not at its beginning).
inline bool same_words(std::string_view words, const char* display) {
  // Nearly all comparisons of a deck end at the first letter.
  return !words.empty() && words.front() == *display && same_spelling(words, display);
}

/// "; did you mean `x`?" when one of the choices is near to what came, otherwise "".
std::string suggestion(std::string_view words, Choices choices);

/// "a, b, c"
std::string joined(Choices choices);

}  // namespace mbdae::reading
