// The cards of a deck and their arguments: keywords, numbers, labels, strings; include files; recovery after errors.
//
// Every reading function stands at the start of an argument when called and leaves at the start of the next one.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "mbdae/deck/diagnostic.h"
#include "mbdae/deck/evaluate.h"
#include "mbdae/deck/expression.h"
#include "mbdae/deck/lexer.h"

namespace mbdae::reading {

/// A run of words in lower case without blanks, as keywords are compared.
struct Words {
  std::string text;
  std::string written;  ///< as written, with single blanks (only of cards and by `peek_words`)
  SourcePosition where;
  bool is(const char* keyword) const { return same_words(text, keyword); }
};

/// A label as it was written.
struct Label {
  std::uint32_t value = 0;
  std::string constant;  ///< lower-case name when written as a single named constant, otherwise ""
  SourcePosition where;
};

class Input {
 public:
  explicit Input(Diagnostics& diagnostics) : diagnostics_(diagnostics), symbols_(std::make_shared<Symbols>()) {
    state_.symbols = symbols_.get();
  }

  // ---- files
  /// Opens the deck itself. `text` is moved in.
  void open(std::string text, const std::string& name);

  // ---- cards
  /// The next card's words, with includes entered and left on the way; null at the end of the deck. They are there
  /// until the next card is asked for. Afterwards the input stands at its first argument.
  const Words* next_card();
  /// The card must end here; takes its `;`.
  void end_card();
  /// A comma before the card's end, which few cards may have, is all right here.
  void allow_trailing_comma() { after_comma_ = after_comma_ && !tokens().peek().is(";"); }
  /// After an error: goes on to what looks like the next card.
  void skip_card();
  /// Reads what is left of a card that has no effect; its expressions must still make sense.
  void ignore_arguments();
  /// `include: "file";`
  void include();
  /// `chdir: "directory";`: where relative names of files in this file are looked for from here on.
  void change_directory();
  /// A file that the deck names, as seen from the file being read.
  std::string path_of(const std::string& name) const;
  /// `set: ...;`
  void set();
  SourcePosition card_position() const { return card_position_; }

  // ---- arguments
  /// True if there is another argument.
  bool more();
  /// Where the next argument stands.
  SourcePosition where() { return tokens().peek().where; }
  /// The argument is nothing at all: `,,`. Takes it.
  bool take_empty();
  /// Takes the argument if it is this keyword.
  bool take(const char* keyword) { return first_letter() == *keyword && take_spelled(keyword); }
  /// The same of a keyword that ends with a number: "use invariant", "9".
  bool take_numbered(const char* keyword, std::string_view number);
  /// Takes the argument if it is one of the choices, else -1.
  int take_any(Choices choices);
  /// The argument must be one of the choices; `what` names the kind of thing ("joint type") in messages.
  int keyword(Choices choices, const char* what);
  /// Takes the argument if it is one of the cards `CARD:` within another card, else -1.
  int take_card(Choices choices);
  /// The argument as plain words, without taking it; nullopt if it is something else.
  std::optional<Words> peek_words();
  /// True if `peek_words` has something to give.
  bool at_words();
  /// True if the argument begins with a real number.
  bool at_real() { return tokens().peek(tokens().peek().is("-") ? 1 : 0).kind == TokenKind::real; }
  /// The first token of the argument.
  std::string_view peek_text() { return tokens().peek().text; }
  /// The argument must be this keyword.
  void require(const char* keyword);
  /// Stops unless there is another argument.
  void need(const char* what) {
    if (!more()) missing(what);
  }
  /// The same with a text that is only made when it is needed.
  template <class Text>
  void need(const Text& text) requires requires {
    std::string(text());
  }
  {
    if (!more()) missing(text());
  }

  double real(const char* what);
  double positive(const char* what);
  std::int64_t integer(const char* what);
  Label label(const char* what);
  bool yes_no();
  bool boolean(const char* what);
  std::string string(const char* what);
  /// "abc" when the argument is a string, else nullopt.
  std::optional<std::string> take_string();

  /// Parses the content of a string drive at the argument.
  std::shared_ptr<const StringDrive> string_drive(double time_step, double check_time,
                                                  const std::function<DrivePtr(const Label&)>& find_drive);

  [[noreturn]] void fail(const SourcePosition& where, std::string message) {
    diagnostics_.fail(where, std::move(message));
  }
  Diagnostics& diagnostics() { return diagnostics_; }
  const Symbols& symbols() const { return *symbols_; }
  /// From here on `Time` has a value, 0, in what is read.
  void start_clock() { symbols_->knows_time = true; }
  /// Value of model::current("L0") for the expressions to come [m]; null to forget it.
  void set_current_length(const double* length) { state_.current_length = length; }

 private:
  struct Source {
    std::string text;
    std::string name;
    std::string canonical;  ///< name; empty until an include asks for it
    std::string directory;  ///< by `chdir`; empty: that of the file
    TokenStream tokens;
  };

  TokenStream& tokens() { return sources_.back()->tokens; }
  void push(std::string text, const std::string& name);
  bool scan_words(std::string* text, std::string* written = nullptr);
  /// `take` of a keyword that begins like the argument.
  bool take_spelled(const char* keyword);
  /// Of the argument's first word, in lower case; '\0' when there is none. Nearly all keywords fail by it.
  char first_letter() {
    const Token& token = tokens().peek();
    if (token.kind != TokenKind::word) return '\0';
    return lower(token.text.front());
  }
  [[noreturn]] void missing(const std::string& what);
  void end_argument();
  void next_token();
  /// The value as an integer; an error if it is none.
  std::int64_t whole_number(const SourcePosition& where, const Value<double>& value, const char* what);
  /// Evaluates the expression at the argument.
  Value<double> expression(const char* what, Label* label);
  /// The same for an argument that is just a number or a variable with a number; nullopt, with nothing taken, for
  /// others.
  std::optional<Number> plain_argument(Label* label);
  Value<double> evaluated(const Expression& expression);
  void forget_new_symbols(std::size_t before, std::string_view declared);

  Diagnostics& diagnostics_;
  std::shared_ptr<Symbols> symbols_;
  ReadingState state_;
  std::vector<std::unique_ptr<Source>> sources_;
  Expression expression_;
  SourcePosition card_position_;
  Words card_;
  bool after_comma_ = false;
  bool card_has_arguments_ = false;
  std::size_t characters_read_ = 0;
  int includes_ = 0;
};

}  // namespace mbdae::reading
