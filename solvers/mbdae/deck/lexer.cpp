// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/lexer.h"

#include <array>

#include "mbdae/deck/diagnostic.h"

namespace mbdae::reading {
namespace {

enum CharacterClass : unsigned char {
  kLetter = 1,
  kDigit = 2,
  kBlank = 4,
  kNewline = 8,
  kSymbol = 16,
  kPair = 32,     ///< may begin a symbol of two characters
  kPairEnd = 64,  ///< may end one
  kComment = 128  ///< may begin a comment
};

/// Classes of the 256 bytes.
constexpr std::array<unsigned char, 256> kClasses = [] {
  std::array<unsigned char, 256> table{};
  for (int c = 'a'; c <= 'z'; ++c) table[static_cast<std::size_t>(c)] = kLetter;
  for (int c = 'A'; c <= 'Z'; ++c) table[static_cast<std::size_t>(c)] = kLetter;
  table['_'] = kLetter;
  for (int c = '0'; c <= '9'; ++c) table[static_cast<std::size_t>(c)] = kDigit;
  for (const char c : std::string_view(" \t\r\f\v")) table[static_cast<unsigned char>(c)] = kBlank;
  table['\n'] = kNewline;
  for (const char c : std::string_view(",;:()+-*/%^!=<>")) table[static_cast<unsigned char>(c)] = kSymbol;
  for (const char c : std::string_view(":=!<>&|~")) table[static_cast<unsigned char>(c)] |= kPair;
  for (const char c : std::string_view(":=&|")) table[static_cast<unsigned char>(c)] |= kPairEnd;
  for (const char c : std::string_view("#/")) table[static_cast<unsigned char>(c)] |= kComment;
  return table;
}();

bool has_class(char c, unsigned classes) { return (kClasses[static_cast<unsigned char>(c)] & classes) != 0; }
bool is_letter(char c) { return has_class(c, kLetter); }
bool is_digit(char c) { return has_class(c, kDigit); }

constexpr std::size_t kLongestWord = 1000;

constexpr std::array<std::string_view, 8> kDoubleSymbols = {"::", "==", "!=", "<=", ">=", "&&", "||", "~|"};

}  // namespace

std::string described(const Token& token) {
  switch (token.kind) {
    case TokenKind::end:
      return "the end of the file";
    case TokenKind::string:
      return "the string " + quoted(token.text);
    case TokenKind::bad:
      return std::string(token.text);
    default:
      return quoted(token.text);
  }
}

std::string unescaped(std::string_view raw) {
  std::string out;
  out.reserve(raw.size());
  for (std::size_t i = 0; i < raw.size(); ++i) {
    if (raw[i] == '\\' && i + 1 < raw.size() && (raw[i + 1] == '"' || raw[i + 1] == '\\')) ++i;
    out += raw[i];
  }
  return out;
}

SourcePosition Lexer::here() const { return {file_, line_, static_cast<int>(position_ - line_start_) + 1}; }

Token Lexer::make(TokenKind kind, std::size_t begin, const SourcePosition& where) const {
  return {kind, {text_.data() + begin, position_ - begin}, where};
}

void Lexer::skip(std::size_t position, unsigned classes) {
  // In a local variable: a member would be written to memory after every character.
  while (position < text_.size() && has_class(text_[position], classes)) ++position;
  position_ = position;
}

bool Lexer::skip_blanks(SourcePosition* unfinished) {
  while (position_ < text_.size()) {
    const char c = text_[position_];
    if (c == '\n') {
      ++line_;
      line_start_ = ++position_;
    } else if (has_class(c, kBlank)) {
      skip(position_ + 1, kBlank);
    } else if (comments_ && c == '#') {
      const std::size_t newline = text_.find('\n', position_);
      position_ = newline == std::string_view::npos ? text_.size() : newline;
    } else if (comments_ && c == '/' && position_ + 1 < text_.size() && text_[position_ + 1] == '*') {
      *unfinished = here();
      const std::size_t close = text_.find("*/", position_ + 2);
      const std::size_t stop = close == std::string_view::npos ? text_.size() : close + 2;
      for (; position_ < stop; ++position_) {
        if (text_[position_] == '\n') {
          ++line_;
          line_start_ = position_ + 1;
        }
      }
      if (close == std::string_view::npos) return false;
    } else {
      break;
    }
  }
  return true;
}

Token Lexer::next() {
  if (position_ < text_.size() && has_class(text_[position_], kBlank | kNewline | kComment)) {
    SourcePosition unfinished;
    if (!skip_blanks(&unfinished)) return {TokenKind::bad, "a comment that is never closed by `*/`", unfinished};
  }
  const SourcePosition where = here();
  if (position_ >= text_.size()) return {TokenKind::end, {}, where};
  const std::size_t begin = position_;
  const char c = text_[position_];
  const char d = position_ + 1 < text_.size() ? text_[position_ + 1] : '\0';
  if (is_letter(c)) {
    skip(position_ + 1, kLetter | kDigit);
    if (position_ - begin > kLongestWord) return {TokenKind::bad, "a word of more than 1000 characters", where};
    return make(TokenKind::word, begin, where);
  }
  if (is_digit(c) || (c == '.' && is_digit(d))) return number(where);
  if (c == '"') return string(where);
  if (has_class(c, kPair) && has_class(d, kPairEnd)) {
    const std::string_view two = text_.substr(position_, 2);
    for (const std::string_view symbol : kDoubleSymbols) {
      if (two != symbol) continue;
      position_ += 2;
      return make(TokenKind::symbol, begin, where);
    }
  }
  ++position_;
  if (has_class(c, kSymbol)) return make(TokenKind::symbol, begin, where);
  // One message for a run of foreign bytes (a UTF-8 letter, say).
  while (position_ < text_.size() && (static_cast<unsigned char>(text_[position_]) & 0xc0) == 0x80) ++position_;
  return {TokenKind::symbol, text_.substr(begin, position_ - begin), where};
}

Token Lexer::number(const SourcePosition& where) {
  const std::size_t begin = position_;
  bool real = false;
  skip(position_, kDigit);
  if (position_ < text_.size() && text_[position_] == '.') {
    real = true;
    skip(position_ + 1, kDigit);
  }
  // `1.d0` is Fortran's way of writing 1.e0.
  if (position_ < text_.size() && (lower(text_[position_]) == 'e' || lower(text_[position_]) == 'd')) {
    std::size_t digit = position_ + 1;
    if (digit < text_.size() && (text_[digit] == '+' || text_[digit] == '-')) ++digit;
    if (digit < text_.size() && is_digit(text_[digit])) {
      real = true;
      skip(digit, kDigit);
    }
  }
  if (position_ < text_.size() && is_letter(text_[position_])) {
    skip(position_, kLetter | kDigit);
    return {TokenKind::bad, "a number run into letters", where};
  }
  return make(real ? TokenKind::real : TokenKind::integer, begin, where);
}

Token Lexer::string(const SourcePosition& where) {
  const std::size_t begin = ++position_;
  const std::size_t start_line_position = position_;
  int lines = 0;
  std::size_t last_line_start = line_start_;
  for (std::size_t i = begin; i < text_.size(); ++i) {
    if (text_[i] == '\\') {
      ++i;
    } else if (text_[i] == '"') {
      position_ = i + 1;
      line_ += lines;
      line_start_ = last_line_start;
      return {TokenKind::string, text_.substr(begin, i - begin), where};
    }
    if (i < text_.size() && text_[i] == '\n') {
      ++lines;
      last_line_start = i + 1;
    }
  }
  // Never closed: go on with the next line, where the author probably thinks we are.
  const std::size_t newline = text_.find('\n', start_line_position);
  position_ = newline == std::string_view::npos ? text_.size() : newline;
  return {TokenKind::bad, "a string that is never closed by `\"`", where};
}

}  // namespace mbdae::reading
