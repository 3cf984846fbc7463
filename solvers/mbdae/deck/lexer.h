// Text to tokens, one at a time, with their place in the file.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "mbdae/deck/deck.h"

namespace mbdae::reading {

enum class TokenKind : std::uint8_t { word, integer, real, string, symbol, end, bad };

struct Token {
  TokenKind kind = TokenKind::end;
  /// The characters of the token; between the quotes for strings (escapes not yet resolved); the complaint for `bad`.
  std::string_view text;
  SourcePosition where;

  bool is(std::string_view symbol) const { return kind == TokenKind::symbol && text == symbol; }
};

/// How a token is named in a message: `text`, "the end of the file", "the string `text`".
std::string described(const Token& token);

/// The content of a string token with \" and \\ resolved.
std::string unescaped(std::string_view raw);

/// A position in a text. Small and copyable: a copy looks ahead without moving the original.
class Lexer {
 public:
  /// `text` must outlive the lexer and its tokens. Comments are part of decks, not of run-time expressions.
  Lexer(std::string_view text, int file, bool comments = true) : text_(text), file_(file), comments_(comments) {}

  Token next();

 private:
  SourcePosition here() const;
  Token make(TokenKind kind, std::size_t begin, const SourcePosition& where) const;
  /// Skips blanks and comments; false when a block comment never ends.
  bool skip_blanks(SourcePosition* unfinished);
  Token number(const SourcePosition& where);
  Token string(const SourcePosition& where);

  std::string_view text_;
  std::size_t position_ = 0;
  std::size_t line_start_ = 0;
  int line_ = 1;
  int file_ = 0;
  bool comments_ = true;
};

/// A lexer with one token in hand.
class TokenStream {
 public:
  explicit TokenStream(const Lexer& lexer) : lexer_(lexer) {}

  const Token& peek() {
    if (!loaded_) {
      token_ = lexer_.next();
      loaded_ = true;
    }
    return token_;
  }
  Token take() {
    peek();
    loaded_ = false;
    return token_;
  }
  /// A lexer standing behind the token in hand.
  Lexer ahead() {
    peek();
    return lexer_;
  }

 private:
  Lexer lexer_;
  Token token_;
  bool loaded_ = false;
};

}  // namespace mbdae::reading
