// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/arguments.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <utility>

namespace mbdae::reading {
namespace {

constexpr std::size_t kLongestKeyword = 64;

void append_lower(std::string_view word, std::string* text) {
  const std::size_t had = text->size();
  text->resize(had + word.size());
  char* const begin = text->data() + had;
  for (std::size_t i = 0; i < word.size(); ++i) begin[i] = lower(word[i]);
}

bool ends_argument(const Token& token) { return token.is(",") || token.is(";"); }

bool ends_words(const Token& token) { return ends_argument(token) || token.is(":") || token.kind == TokenKind::end; }

}  // namespace

void Input::next_token() { tokens().take(); }

bool Input::scan_words(std::string* text, std::string* written) {
  static_assert(kLongestKeyword + 2 < TokenStream::kInHand);  // no word has less than one letter
  const Token* token = &tokens().peek();
  if (token->kind != TokenKind::word) return false;
  text->clear();
  for (std::size_t ahead = 1; token->kind == TokenKind::word && text->size() <= kLongestKeyword; ++ahead) {
    append_lower(token->text, text);
    if (written != nullptr) written->append(written->empty() ? "" : " ").append(token->text);
    token = &tokens().peek(ahead);
  }
  return ends_words(*token);
}

const Words* Input::next_card() {
  while (true) {
    const Token& token = tokens().peek();
    card_position_ = token.where;
    if (token.kind == TokenKind::end) {
      if (sources_.size() == 1) return nullptr;
      sources_.pop_back();
      continue;
    }
    if (token.is(";")) {
      const SourcePosition where = token.where;
      next_token();
      fail(where, "found `;` without a card before it, expected a card");
    }
    if (token.kind != TokenKind::word) fail(token.where, "found " + described(token) + ", expected a card");
    card_.where = card_position_;
    card_.written.clear();
    scan_words(&card_.text, &card_.written);
    while (tokens().peek().kind == TokenKind::word) next_token();
    card_has_arguments_ = tokens().peek().is(":");
    after_comma_ = false;
    if (card_has_arguments_) {
      next_token();
    } else if (!tokens().peek().is(";")) {
      fail(tokens().peek().where, "found " + described(tokens().peek()) + " after the card name " +
                                      quoted(card_.written) + ", expected `:` or `;`");
    }
    return &card_;
  }
}

bool Input::more() {
  const Token& token = tokens().peek();
  if (token.kind == TokenKind::end) fail(token.where, "the file ends inside a card, expected `;`");
  return !token.is(";");
}

void Input::end_card() {
  const Token token = tokens().peek();
  if (after_comma_ && token.is(";")) fail(token.where, "found `;` after a comma, expected another argument");
  if (!token.is(";")) {
    // Options that end cards, in case one of them was meant.
    static constexpr const char* kOptions[] = {"output",
                                               "orientation description",
                                               "inverse dynamics",
                                               "initial state",
                                               "initial theta",
                                               "prestress",
                                               "prestrain",
                                               "position",
                                               "orientation",
                                               "scale",
                                               "position constraint",
                                               "orientation constraint",
                                               "reflexive",
                                               "ergonomy",
                                               "activation check",
                                               "short range stiffness"};
    const std::optional<Words> words = peek_words();
    const std::string hint = words ? suggestion(words->text, kOptions) : "";
    const auto is_word = [&](const char* option) { return words->is(option); };
    if (words && std::any_of(std::begin(kOptions), std::end(kOptions), is_word)) {
      fail(token.where, quoted(words->written) + " does not belong here, expected `;`");
    }
    if (words && hint.empty() && !symbols_->find(token.text)) {
      fail(token.where, "not supported: the option " + quoted(words->written) + " of this card, expected `;`");
    }
    fail(token.where, "found " + (words ? quoted(words->written) : described(token)) + ", expected `;`" + hint);
  }
  next_token();
}

void Input::skip_card() {
  // A card starts with words and a colon (or is words and `;`); nothing inside a card looks like that.
  const auto card_here = [this](bool after_semicolon) {
    if (tokens().peek().kind == TokenKind::end) return true;
    if (tokens().peek().kind != TokenKind::word) return false;
    std::size_t ahead = 1;
    while (ahead < 9 && tokens().peek(ahead).kind == TokenKind::word) ++ahead;
    const Token& token = tokens().peek(ahead);
    return token.is(":") || (after_semicolon && token.is(";"));
  };
  bool after_semicolon = false;
  // Past the card's own name when the error stands on it.
  const SourcePosition here = tokens().peek().where;
  if (here.file == card_position_.file && here.line == card_position_.line && here.column == card_position_.column &&
      tokens().peek().kind != TokenKind::end) {
    after_semicolon = tokens().peek().is(";");
    next_token();
  }
  while (!card_here(after_semicolon)) {
    after_semicolon = tokens().peek().is(";");
    next_token();
  }
}

void Input::ignore_arguments() {
  while (more()) {
    if (take_empty()) continue;
    if (at_words()) {
      while (tokens().peek().kind == TokenKind::word) next_token();
      end_argument();
    } else {
      expression("an argument", nullptr);
    }
  }
}

void Input::set() {
  const std::size_t before = symbols_->size();
  expression_.clear();
  ExpressionParser parser(tokens(), *symbols_, diagnostics_, expression_, false);
  try {
    need("a declaration (`real A = 1.`) or an assignment (`A = 2.`)");
    parser.parse_statement();
    end_card();
    evaluated(expression_);
  } catch (const Reported&) {
    forget_new_symbols(before, parser.declared());
    throw;
  }
}

void Input::forget_new_symbols(std::size_t before, std::string_view declared) {
  for (std::size_t i = before; i < symbols_->size(); ++i) (*symbols_)[static_cast<std::uint32_t>(i)].broken = true;
  if (!declared.empty() && !symbols_->find(declared)) {
    Variable variable;
    variable.name = std::string(declared);
    variable.broken = true;
    symbols_->add(std::move(variable));
  }
}

Value<double> Input::evaluated(const Expression& expression) {
  try {
    return evaluate(expression, state_);
  } catch (const EvaluationError& error) {
    fail(error.where, error.message);
  } catch (const BrokenVariable&) {
    throw Reported{};
  }
}

void Input::end_argument() {
  const Token& token = tokens().peek();
  after_comma_ = token.is(",");
  if (after_comma_) {
    next_token();
  } else if (token.kind == TokenKind::end) {
    fail(token.where, "the file ends inside a card, expected `;`");
  } else if (!token.is(";")) {
    fail(token.where, "found " + described(token) + ", expected `,` or `;`");
  }
}

void Input::missing(const std::string& what) { fail(where(), "the card ends here, expected " + what); }

bool Input::take_empty() {
  if (!tokens().peek().is(",")) return false;
  end_argument();
  return true;
}

bool Input::at_words() {
  std::string words;
  return scan_words(&words);
}

std::optional<Words> Input::peek_words() {
  if (!at_words()) return std::nullopt;
  Words words{{}, {}, where()};
  scan_words(&words.text, &words.written);
  return words;
}

bool Input::take_spelled(const char* keyword) {
  TokenStream& stream = tokens();
  std::size_t words = 0;
  const char* rest = keyword;
  for (; stream.peek(words).kind == TokenKind::word; ++words) {
    for (const char c : stream.peek(words).text) {
      if (*rest == ' ') ++rest;
      if (lower(c) != *rest) return false;
      ++rest;
    }
  }
  if (*rest != '\0' || !ends_words(stream.peek(words))) return false;
  for (; words > 0; --words) stream.take();
  end_argument();
  return true;
}

bool Input::take_numbered(const char* keyword, std::string_view number) {
  TokenStream& stream = tokens();
  std::string words;
  std::size_t count = 0;
  for (; stream.peek(count).kind == TokenKind::word && words.size() <= kLongestKeyword; ++count) {
    append_lower(stream.peek(count).text, &words);
  }
  if (!same_words(words, keyword) || stream.peek(count).text != number || !ends_words(stream.peek(count + 1))) {
    return false;
  }
  for (++count; count > 0; --count) stream.take();
  end_argument();
  return true;
}

int Input::take_card(Choices choices) {
  const std::optional<Words> words = peek_words();
  if (!words) return -1;
  for (std::size_t i = 0; i < choices.size(); ++i) {
    if (!words->is(choices[i])) continue;
    std::size_t ahead = 0;
    while (tokens().peek(ahead).kind == TokenKind::word) ++ahead;
    if (!tokens().peek(ahead).is(":")) return -1;
    for (std::size_t k = 0; k <= ahead; ++k) next_token();
    after_comma_ = false;
    return static_cast<int>(i);
  }
  return -1;
}

int Input::take_any(Choices choices) {
  const char letter = first_letter();
  for (std::size_t i = 0; i < choices.size(); ++i) {
    if (letter == *choices[i] && take(choices[i])) return static_cast<int>(i);
  }
  return -1;
}

int Input::keyword(Choices choices, const char* what) {
  const auto expected = [&] {
    const bool vowel = std::string_view("aeio").find(*what) != std::string_view::npos;
    return (vowel ? "an " : "a ") + std::string(what) + ": " + joined(choices);
  };
  need(expected);
  const int found = take_any(choices);
  if (found >= 0) return found;
  const std::optional<Words> words = peek_words();
  const Token& token = tokens().peek();
  if (!words) fail(token.where, "found " + described(token) + ", expected " + expected());
  const std::string hint = suggestion(words->text, choices);
  fail(token.where, (hint.empty() ? "not supported: the " : "unknown ") + std::string(what) + " " +
                        quoted(words->written) + ", expected: " + joined(choices) + hint);
}

void Input::require(const char* keyword) {
  need([&] { return quoted(keyword); });
  if (take(keyword)) return;
  const Token& token = tokens().peek();
  const std::optional<Words> words = peek_words();
  const char* const choices[] = {keyword};
  fail(token.where, "found " + (words ? quoted(words->written) : described(token)) + ", expected " + quoted(keyword) +
                        (words ? suggestion(words->text, choices) : ""));
}

std::optional<Number> Input::plain_argument(Label* label) {
  TokenStream& stream = tokens();
  const Token& first = stream.peek();
  const std::size_t size = first.is("-") ? 2 : 1;
  if (!ends_argument(stream.peek(size))) return std::nullopt;
  Number number;
  if (first.kind == TokenKind::word) {
    const auto symbol = symbols_->find(first.text);
    if (!symbol) return std::nullopt;
    const Variable& variable = (*symbols_)[*symbol];
    if (variable.broken || !variable.has_value || variable.value.type == Type::string) return std::nullopt;
    number = {variable.value.type, variable.value.integer, variable.value.real};
    if (label != nullptr) append_lower(first.text, &label->constant);
  } else {
    if (!read_number(stream.peek(size - 1), &number)) return std::nullopt;
    if (size == 2) {
      number.integer = -number.integer;
      number.real = -number.real;
    }
  }
  for (std::size_t i = 0; i < size; ++i) stream.take();
  end_argument();
  return number;
}

Value<double> Input::expression(const char* what, Label* label) {
  need(what);
  // Nine arguments in ten need no tree.
  if (const std::optional<Number> number = plain_argument(label))
    return {number->type, number->integer, number->real, {}};
  const Token first = tokens().peek();
  if (first.kind == TokenKind::symbol && !first.is("(") && !first.is("-") && !first.is("+") && !first.is("!")) {
    fail(first.where, "found " + described(first) + ", expected " + what);
  }
  const std::size_t before = symbols_->size();
  expression_.clear();
  ExpressionParser parser(tokens(), *symbols_, diagnostics_, expression_, false);
  try {
    const bool word = first.kind == TokenKind::word;
    if (word && !symbols_->find(first.text)) {
      // A word nobody knows, alone or in a row: more likely a keyword out of place than a variable.
      const std::optional<Words> words = peek_words();
      if (words && words->text.size() != first.text.size()) {
        fail(first.where, "not supported: " + quoted(words->written) + " here, expected " + what);
      }
      const bool keyword =
          std::all_of(first.text.begin(), first.text.end(), [](char c) { return c >= 'a' && c <= 'z'; });
      if (words && keyword && first.text.size() > 3) {
        fail(first.where, "not supported: " + quoted(first.text) + " here, expected " + what);
      }
    }
    parser.parse_expression();
    Value<double> value = evaluated(expression_);
    if (label != nullptr) {
      const ExpressionNode& root = expression_.nodes[static_cast<std::size_t>(expression_.root)];
      if (root.op == Op::variable) append_lower((*symbols_)[root.index].name, &label->constant);
    }
    end_argument();
    return value;
  } catch (const Reported&) {
    forget_new_symbols(before, "");
    throw;
  }
}

double Input::real(const char* what) {
  if (take_empty()) return 0.0;
  if (const std::optional<Number> number = plain_argument(nullptr)) {
    return number->type == Type::real ? number->real : static_cast<double>(number->integer);
  }
  const SourcePosition where = this->where();
  const Value<double> value = expression(what, nullptr);
  if (value.type == Type::string) fail(where, "found the string " + quoted(value.text) + ", expected " + what);
  return value.type == Type::real ? value.real : static_cast<double>(value.integer);
}

double Input::positive(const char* what) {
  const SourcePosition where = this->where();
  const double value = real(what);
  if (!(value > 0.0)) fail(where, "found " + number_text(value) + ", expected " + what + " greater than zero");
  return value;
}

std::int64_t Input::integer(const char* what) {
  const SourcePosition where = this->where();
  return whole_number(where, expression(what, nullptr), what);
}

std::int64_t Input::whole_number(const SourcePosition& where, const Value<double>& value, const char* what) {
  if (value.type == Type::string) fail(where, "found the string " + quoted(value.text) + ", expected " + what);
  if (value.type != Type::real) return value.integer;
  // A power, say, is real also of integers.
  constexpr double kLargest = 2147483647.0;
  if (value.real != std::trunc(value.real) || std::abs(value.real) > kLargest) {
    fail(where, "found " + number_text(value.real) + ", expected " + what + " (an integer)");
  }
  return static_cast<std::int64_t>(value.real);
}

Label Input::label(const char* what) {
  Label label;
  label.where = where();
  const std::int64_t value = whole_number(label.where, expression(what, &label), what);
  if (value < 0) fail(label.where, "found " + std::to_string(value) + ", expected " + what + " from 0 on");
  label.value = static_cast<std::uint32_t>(value);
  return label;
}

bool Input::yes_no() {
  static constexpr const char* kChoices[] = {"yes", "no"};
  if (const auto words = peek_words(); !words || (!words->is("yes") && !words->is("no"))) {
    if (!words || symbols_->find(tokens().peek().text)) return boolean("yes or no");
  }
  return keyword(kChoices, "choice") == 0;
}

bool Input::boolean(const char* what) {
  const SourcePosition where = this->where();
  return whole_number(where, expression(what, nullptr), what) != 0;
}

std::optional<std::string> Input::take_string() {
  const Token token = tokens().peek();
  if (token.kind != TokenKind::string) return std::nullopt;
  next_token();
  end_argument();
  return unescaped(token.text);
}

std::string Input::string(const char* what) {
  need(what);
  if (auto text = take_string()) return *std::move(text);
  fail(where(), "found " + described(tokens().peek()) + ", expected " + what);
}

std::shared_ptr<const StringDrive> Input::string_drive(double time_step, double check_time,
                                                       const std::function<DrivePtr(const Label&)>& find_drive) {
  need("an expression in quotes");
  const Token token = tokens().peek();
  if (token.kind != TokenKind::string)
    fail(token.where, "found " + described(token) + ", expected an expression in quotes");
  std::string text = unescaped(token.text);
  for (char& c : text) {
    if (std::isspace(static_cast<unsigned char>(c)) != 0)
      c = ' ';  // one line, so that columns count from its beginning
  }
  Diagnostics inner;  // positions inside the string mean nothing to the reader: tell the string's own
  TokenStream stream(Lexer(text, 0, false));
  Expression expression;
  const auto complaint = [&](const SourcePosition& where, std::string message) {
    static const std::string kFile = "the end of the file";
    if (const std::size_t at = message.find(kFile); at != std::string::npos) {
      message.replace(at, kFile.size(), "the end of the string");
    }
    fail(token.where, "in the string, at character " + std::to_string(where.column) + ": " + message);
  };
  try {
    const auto find = [&](const Token&, std::uint32_t label) { return find_drive({label, "", token.where}); };
    ExpressionParser parser(stream, *symbols_, inner, expression, true, find);
    parser.parse_statements();
    const Token& rest = stream.peek();
    if (rest.kind != TokenKind::end)
      inner.fail(rest.where, "found " + described(rest) + ", expected the end of the string");
  } catch (const Reported&) {
    const std::vector<Diagnostic> messages = inner.take();
    if (messages.empty()) throw;
    complaint({0, 1, messages.front().column}, messages.front().message);
  }
  next_token();
  end_argument();
  auto drive = std::make_shared<const StringDrive>(std::move(expression), symbols_, time_step);
  try {
    drive->checked(check_time);
  } catch (const EvaluationError& error) {
    complaint(error.where, error.message + " (at time " + number_text(check_time) + " s)");
  } catch (const BrokenVariable&) {
    throw Reported{};
  }
  return drive;
}

}  // namespace mbdae::reading
