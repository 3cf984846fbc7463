// Small decks for the tests of the deck reader.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <catch2/catch.hpp>

#include <fstream>
#include <sstream>
#include <string>
#include <utility>

#include "mbdae/elements/deformable_hinge.h"
#include "mbdae/elements/deformable_joint.h"
#include "mbdae/elements/distance.h"
#include "mbdae/elements/force.h"
#include "mbdae/elements/hinge.h"
#include "mbdae/elements/rod.h"
#include "mbdae/elements/table.h"
#include "mbdae/elements/total.h"

namespace deck_test {

/// How often `word` stands in `text`.
inline int occurrences(const std::string& text, const std::string& word) {
  int count = 0;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++count;
  return count;
}

/// The parts of a small deck; the counts of the control data follow from the cards.
struct DeckText {
  std::string globals;  ///< between the control data and the nodes
  std::string nodes =
      "structural: 1, dynamic, null, eye, null, null;\nstructural: 2, dynamic, 1., 2., 3., eye, null, null;\n";
  std::string elements;
  std::string initial = "initial time: 0.; final time: 1.; time step: 0.01; method: ms, 0.6;\n";
  std::string control;

  /// Lines: 1 data, 2 initial value, 3 its cards, 4 control data, 5 counts, 6 own cards, 7 end, 8 globals, ...
  std::string text() const {
    const std::string gravity = occurrences(elements, "gravity:") > 0 ? " gravity;" : "";
    return "begin: data; problem: initial value; end: data;\nbegin: initial value;\n" + initial +
           "end: initial value; begin: control data;\nstructural nodes: " +
           std::to_string(occurrences(nodes, "structural:")) +
           "; rigid bodies: " + std::to_string(occurrences(elements, "body:")) +
           "; joints: " + std::to_string(occurrences(elements, "joint:")) +
           "; forces: " + std::to_string(occurrences(elements, "force:") + occurrences(elements, "couple:")) + ";" +
           gravity + "\n" + control + "\nend: control data;\n" + globals + "\nbegin: nodes;\n" + nodes +
           "end: nodes;\nbegin: elements;\n" + elements + "end: elements;\n";
  }
};

inline std::string messages(const mbdae::ReadResult& result) {
  std::string out;
  for (const auto& diagnostic : result.diagnostics) out += diagnostic.format() + "\n";
  return out;
}

/// The deck, which must be right.
inline mbdae::Deck read_good(const std::string& text) {
  mbdae::ReadResult result = mbdae::read_deck_text(text, "test.mbd");
  INFO(messages(result));
  REQUIRE(result.deck.has_value());
  return *std::move(result.deck);
}

inline mbdae::Deck read_good(const DeckText& deck) { return read_good(deck.text()); }

/// The deck with these elements.
inline mbdae::Deck with_elements(const std::string& elements) {
  DeckText deck;
  deck.elements = elements;
  return read_good(deck);
}

inline mbdae::Deck with_nodes(const std::string& nodes, const std::string& globals = "") {
  DeckText deck;
  deck.nodes = nodes;
  deck.globals = globals;
  return read_good(deck);
}

/// The only joint of the deck, of the given type.
template <class Joint>
Joint only_joint(const mbdae::Deck& deck) {
  REQUIRE(deck.joints.size() == 1);
  REQUIRE(deck.joints.front().get_if<Joint>() != nullptr);
  return deck.joints.front().as<Joint>();
}

/// What is said about a deck that is wrong.
inline std::string complaint(const std::string& text) {
  const mbdae::ReadResult result = mbdae::read_deck_text(text, "test.mbd");
  REQUIRE_FALSE(result.deck.has_value());
  return messages(result);
}

inline std::string load(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  REQUIRE(file.good());
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

}  // namespace deck_test
