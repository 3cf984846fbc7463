// Lexical rules: blanks, cases, comments, strings, numbers of lines and columns.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <string_view>
#include <vector>

#include "mbdae/deck/lexer.h"
#include "test_deck_support.h"

using mbdae::reading::Lexer;
using mbdae::reading::Token;
using mbdae::reading::TokenKind;

namespace {

/// The tokens point into `text`, which is a literal or lives as long as they do.
std::vector<Token> tokens(std::string_view text) {
  Lexer lexer(text, 0);
  std::vector<Token> out;
  for (Token token = lexer.next(); token.kind != TokenKind::end; token = lexer.next()) out.push_back(token);
  return out;
}

}  // namespace

TEST_CASE("tokens know their line and column") {
  const std::string text = "joint: 1,\n\t\"two\nlines\" # rest ; : ,\n  /* block\n ; */ X1 >= 2.e3;";
  const std::vector<Token> found = tokens(text);
  REQUIRE(found.size() == 9);
  const struct {
    const char* text;
    TokenKind kind;
    int line, column;
  } expected[] = {
      {"joint", TokenKind::word, 1, 1}, {":", TokenKind::symbol, 1, 6},          {"1", TokenKind::integer, 1, 8},
      {",", TokenKind::symbol, 1, 9},   {"two\nlines", TokenKind::string, 2, 2}, {"X1", TokenKind::word, 5, 7},
      {">=", TokenKind::symbol, 5, 10}, {"2.e3", TokenKind::real, 5, 13},        {";", TokenKind::symbol, 5, 17}};
  for (std::size_t i = 0; i < found.size(); ++i) {
    CHECK(found[i].text == expected[i].text);
    CHECK(found[i].kind == expected[i].kind);
    CHECK(found[i].where.line == expected[i].line);
    CHECK(found[i].where.column == expected[i].column);
  }
}

TEST_CASE("strings have escapes and an end") {
  CHECK(mbdae::reading::unescaped(tokens(R"("a \"b\" \\ \n")").front().text) == "a \"b\" \\ \\n");
  const std::vector<Token> open = tokens("\"never\nset");
  REQUIRE(open.size() == 2);
  CHECK(open[0].kind == TokenKind::bad);
  CHECK(open[1].text == "set");
  CHECK(tokens("1 /* never").back().kind == TokenKind::bad);
}

TEST_CASE("numbers end where letters begin") {
  CHECK(tokens("1e").front().kind == TokenKind::bad);
  CHECK(tokens("1.5x").front().kind == TokenKind::bad);
  CHECK(tokens("1..2").size() == 2);
  CHECK(tokens("1.e5").front().kind == TokenKind::real);
}

TEST_CASE("keywords ignore blanks and case, names do not") {
  deck_test::DeckText deck;
  deck.globals = "SET: const real k = 2.; set : const real K = 3.;";
  deck.elements =
      "JoInT: 1, TotalJoint, 1, POSITION, null, 2, position, k, K, 0., po sition\norientation, eye, "
      "RotationOrientation, eye,"
      "position constraint, Active, in active, 1, null;\n";
  const auto joint = deck_test::only_joint<mbdae::TotalJointData>(deck_test::read_good([&] {
    std::string text = deck.text();
    text.replace(text.find("joints: 0"), 9, "joints: 1");
    text.replace(text.find("begin: control data"), 19, "BEGIN:\tControl\n Data");
    return text;
  }()));
  CHECK(joint.f2 == mbdae::Vec3(2.0, 3.0, 0.0));
  CHECK(joint.position[1] == mbdae::TotalComponent::inactive);
}

TEST_CASE("empty fields are zero, byte order marks and carriage returns are blanks") {
  deck_test::DeckText deck;
  deck.nodes = "structural: 1, dynamic, 1.,,3., eye,,,, null;\r\n";
  const mbdae::Deck read = deck_test::read_good("\xef\xbb\xbf" + deck.text());
  CHECK(read.nodes[0].x == mbdae::Vec3(1.0, 0.0, 3.0));
  CHECK(read.nodes[0].v == mbdae::Vec3::Zero());
}
