// Text to tokens, one at a time, with their place in the file.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
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

  bool is(std::string_view symbol) const {
    // With the size of a literal, which the compiler knows, this is no call.
    return kind == TokenKind::symbol && text.size() == symbol.size() &&
           __builtin_memcmp(text.data(), symbol.data(), symbol.size()) == 0;
  }
};

/// How a token is named in a message: `text`, "the end of the file", "the string `text`".
std::string described(const Token& token);

/// The content of a string token with \" and \\ resolved.
std::string unescaped(std::string_view raw);

/// A position in a text.
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
  /// Goes to the first character from `position` on that has none of the classes.
  void skip(std::size_t position, unsigned classes);
  Token number(const SourcePosition& where);
  Token string(const SourcePosition& where);

  std::string_view text_;
  std::size_t position_ = 0;
  std::size_t line_start_ = 0;
  int line_ = 1;
  int file_ = 0;
  bool comments_ = true;
};

/// A lexer with the tokens in hand that somebody has looked at: each is made once.
class TokenStream {
 public:
  /// One more than the furthest look ahead; a power of two.
  static constexpr std::size_t kInHand = 128;

  explicit TokenStream(const Lexer& lexer) : lexer_(lexer) {}

  /// The next token, or one `ahead` of it. It stays where it is until `kInHand` - 1 others have been taken.
  const Token& peek(std::size_t ahead = 0) {
    for (; count_ <= ahead; ++count_) tokens_[(first_ + count_) % kInHand] = lexer_.next();
    return tokens_[(first_ + ahead) % kInHand];
  }
  const Token& take() {
    const Token& token = peek();
    ++first_;
    --count_;
    return token;
  }

 private:
  Lexer lexer_;
  std::array<Token, kInHand> tokens_;  // a ring
  std::size_t first_ = 0, count_ = 0;
};

}  // namespace mbdae::reading
