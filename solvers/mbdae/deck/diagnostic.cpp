// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/diagnostic.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <utility>

namespace mbdae {

std::string Diagnostic::format() const {
  std::string text = file;
  if (line > 0) text.append(":").append(std::to_string(line)).append(":").append(std::to_string(column));
  text += severity == Severity::error ? ": error: " : ": warning: ";
  return text + message;
}

namespace reading {

int Diagnostics::add_file(const std::string& name) {
  const auto found = std::find(files_.begin(), files_.end(), name);
  if (found != files_.end()) return static_cast<int>(found - files_.begin());
  files_.push_back(name);
  return static_cast<int>(files_.size()) - 1;
}

void Diagnostics::add(const SourcePosition& where, Severity severity, std::string message) {
  Diagnostic diagnostic;
  const auto file = static_cast<std::size_t>(where.file);
  diagnostic.file = file < files_.size() ? files_[file] : std::string("deck");
  diagnostic.line = where.line;
  diagnostic.column = where.column;
  diagnostic.severity = severity;
  diagnostic.message = std::move(message);
  list_.push_back(std::move(diagnostic));
}

void Diagnostics::error(const SourcePosition& where, std::string message) {
  if (full_) return;
  add(where, Severity::error, std::move(message));
  if (++error_count_ == kLimit) {
    full_ = true;
    add({where.file, 0, 0}, Severity::error,
        "stopped reading after " + std::to_string(kLimit) + " errors: correct these first");
  }
}

void Diagnostics::warning(const SourcePosition& where, std::string message) {
  if (++warning_count_ <= kLimit) add(where, Severity::warning, std::move(message));
}

void Diagnostics::fail(const SourcePosition& where, std::string message) {
  error(where, std::move(message));
  throw Reported{};
}

std::string quoted(std::string_view text) {
  constexpr std::size_t kMost = 40;
  std::string out = "`";
  for (const char c : text.substr(0, kMost)) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte == '\n' || byte == '\t' || byte == '\r') {
      out += ' ';
    } else if (byte < 0x20 || byte >= 0x7f) {
      static const char* const kDigits = "0123456789abcdef";
      out += "\\x";
      out += kDigits[byte >> 4];
      out += kDigits[byte & 15];
    } else {
      out += c;
    }
  }
  if (text.size() > kMost) out += "...";
  return out + "`";
}

std::string number_text(double value) {
  std::array<char, 40> buffer;
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr;
  return std::string(buffer.data(), end);
}

bool same_spelling(std::string_view words, const char* display) {
  std::size_t i = 0;
  for (; *display != '\0'; ++display) {
    if (*display == ' ') continue;
    if (i >= words.size() || words[i] != *display) return false;
    ++i;
  }
  return i == words.size();
}

namespace {

/// Number of single-letter changes (insert, delete, replace, swap of neighbours) from a to b.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> before(b.size() + 1), row(b.size() + 1), next(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    next[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t change = row[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      next[j] = std::min({row[j] + 1, next[j - 1] + 1, change});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        next[j] = std::min(next[j], before[j - 2] + 1);
    }
    std::swap(before, row);
    std::swap(row, next);
  }
  return row[b.size()];
}

}  // namespace

std::string suggestion(std::string_view words, Choices choices) {
  constexpr std::size_t kLongest = 64;
  if (words.size() < 3 || words.size() > kLongest) return "";  // too short to tell, too long to mean one
  std::string lower(words);
  for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  const char* best = nullptr;
  std::size_t best_distance = words.size() <= 5 ? 2 : 3;  // fewer than this many changes
  for (const char* choice : choices) {
    std::string bare;
    for (const char* c = choice; *c != '\0'; ++c) {
      if (*c != ' ') bare += static_cast<char>(std::tolower(static_cast<unsigned char>(*c)));
    }
    if (bare.size() > kLongest || bare.size() > lower.size() + 3 || lower.size() > bare.size() + 3) continue;
    const std::size_t distance = edit_distance(lower, bare);
    if (distance < best_distance) {
      best_distance = distance;
      best = choice;
    }
  }
  return best != nullptr ? std::string("; did you mean `") + best + "`?" : "";
}

std::string joined(Choices choices) {
  std::string out;
  for (const char* choice : choices) {
    if (!out.empty()) out += ", ";
    out += choice;
  }
  return out;
}

}  // namespace reading
}  // namespace mbdae
