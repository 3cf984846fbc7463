// `.fem` files and the cards that use them: what is read, what is refused and how it is told.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <unistd.h>

#include <filesystem>
#include <utility>

#include "mbdae/elements/modal_joint.h"
#include "mbdae/fem/fem_file.h"
#include "test_deck_support.h"

using namespace mbdae;
using namespace deck_test;

namespace {

// Two nodes, two modes; damping, lumped masses.
const std::string kRod =
    "** a rod of two nodes\n"
    "** RECORD GROUP 1, HEADER\n"
    "** revision, nodes, normal, attachment, constraint, rejected modes\n"
    "REV0 2 2 0 0 0\n"
    "** RECORD GROUP 2, FINITE ELEMENT NODE LIST\n"
    "A 102\n"
    "** RECORD GROUP 5, X\n0. 1.\n"
    "** RECORD GROUP 6, Y\n0. 0.\n"
    "** RECORD GROUP 7, Z\n0.\n 0.\n"
    "** RECORD GROUP 8, MODE SHAPES\n"
    "** mode 1\n0. 0. 0. 0. 0. 0.\n0. 0. 1. 0. -1.5 0.\n"
    "\n0. 0. 0. 0. 0. 0.\n0. 1. 0. 0. 0. 1.5\n"
    "** RECORD GROUP 9, MODAL MASS MATRIX\n2. 0. 0. 3.\n"
    "** RECORD GROUP 10, MODAL STIFFNESS MATRIX\n300. 1. -1. 400.\n"
    "** RECORD GROUP 13, MODAL DAMPING MATRIX\n5. 0.5 0.25 6.\n"
    "** RECORD GROUP 11, LUMPED MASSES\n1. 1. 1. 0.01 0.01 0.01\n2. 2. 2. 0.01 0.02 0.03\n"
    "** END OF FILE\nanything\n";

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  const std::size_t at = text.find(what);
  REQUIRE(at != std::string::npos);
  return text.replace(at, what.size(), by);
}

std::string fem_complaint(const std::string& text) {
  reading::Diagnostics diagnostics;
  diagnostics.add_file("body.fem");
  try {
    reading::read_fem(text, 0, diagnostics);
    FAIL("read without a word");
  } catch (const reading::Reported&) {
  }
  std::string out;
  for (const Diagnostic& diagnostic : diagnostics.take()) out += diagnostic.format() + "\n";
  return out;
}

/// A directory with `rod.fem`, gone at the end.
class Files {
 public:
  explicit Files(const std::string& fem = kRod) {
    directory_ = std::filesystem::temp_directory_path() / ("mbdae_fem_" + std::to_string(::getpid()));
    std::filesystem::create_directories(directory_);
    std::ofstream(directory_ / "rod.fem") << fem;
  }
  ~Files() { std::filesystem::remove_all(directory_); }
  std::string deck() const { return (directory_ / "test.mbd").string(); }

 private:
  std::filesystem::path directory_;
};

DeckText modal_deck(const std::string& card, const std::string& more = "") {
  DeckText deck;
  deck.nodes = "structural: 1, modal, null, eye, null, null;\nstructural: 2, dynamic, 1., 0., 0., eye, null, null;\n";
  deck.elements = "joint: 5, modal, " + card + ";\n" + more;
  return deck;
}

ModalData read_card(const std::string& card, const std::string& fem = kRod) {
  const Files files(fem);
  ReadResult result = read_deck_text(modal_deck(card).text(), files.deck());
  INFO(messages(result));
  REQUIRE(result.deck.has_value());
  return result.deck->joints.front().as<ModalData>();
}

std::string card_complaint(const std::string& card, const std::string& more = "", const std::string& fem = kRod) {
  const Files files(fem);
  const ReadResult result = read_deck_text(modal_deck(card, more).text(), files.deck());
  REQUIRE_FALSE(result.deck.has_value());
  return messages(result);
}

const std::string kInterface = "1, 102, 2, null";

}  // namespace

TEST_CASE("a .fem file is read") {
  reading::Diagnostics diagnostics;
  diagnostics.add_file("body.fem");
  const FemFile file = reading::read_fem(kRod, 0, diagnostics);
  CHECK(diagnostics.take().empty());
  CHECK(file.nodes == 2);
  CHECK(file.modes == 2);
  CHECK(file.labels == std::vector<std::string>{"A", "102"});
  CHECK(file.points(0, 1) == 1.0);
  CHECK(file.shape[1](2, 0) == 1.0);
  CHECK(file.shape[1](5, 1) == 1.5);
  CHECK(file.K(0, 1) == 1.0);  // row after row
  CHECK(file.K(1, 0) == -1.0);
  REQUIRE(file.C);
  CHECK((*file.C)(0, 1) == 0.5);
  REQUIRE(file.lumped);
  CHECK((*file.lumped)(3, 1) == 0.03);
  CHECK_FALSE(file.rigid);
  CHECK(file.a.isZero(0.0));
}

TEST_CASE("damaged .fem files: the place and what is wrong") {
  const std::vector<std::pair<std::string, std::string>> cases = {
      {replaced(kRod, "300.", "nan"), "body.fem:24:1: error: found `nan`, expected a finite number: number 1 of 4"},
      {replaced(kRod, "300.", "3D+02"), "write the exponent with E, not with D"},
      {replaced(kRod, "300.", "1e999"), "too large or too small"},
      {replaced(kRod, "300.", "3OO"),
       "found `3OO`, expected number 1 of 4 of record group 10 (modal stiffness matrix)"},
      {replaced(kRod, "300. 1. -1. 400.", "300. 1. -1."), "number 4 of 4 of record group 10"},
      {replaced(kRod, "** RECORD GROUP 9, MODAL MASS MATRIX\n2. 0. 0. 3.\n", ""),
       "record group 9 (modal mass matrix) is missing"},
      {replaced(kRod, "** RECORD GROUP 10", "** RECORD GROUP 9"), "record group 9 stands here again"},
      {replaced(kRod, "REV0 2 2", "REV0 3 2"), "found a line that begins with `**`, expected label 3 of 3 nodes"},
      {replaced(kRod, "REV0 2 2", "REV0 1000000000 2"), "1000000000 nodes and 2 modes, which need a file of"},
      {replaced(kRod, "REV0 2 2", "REV0 2 2000000000"), "2 nodes and 2000000000 modes, which need a file of"},
      {replaced(kRod, "REV0 2 2", "REV0 99999999999999999999 2"), "expected the number of nodes"},
      {replaced(kRod, "REV0 2 2", "REV0 -2 2"), "expected the number of nodes from 0"},
      {replaced(kRod, "REV0 2 2 0 0 0", "REV0 2 2 0 0 2"), "found 0 modes"},
      {replaced(kRod, "REV0 2 2 0 0 0", "REV0 2 2 0"), "expected the number of constraint modes"},
      {replaced(kRod, "** revision, nodes, normal, attachment, constraint, rejected modes\n", ""),
       "found no line of comment"},
      {replaced(kRod, "** mode 1\n", ""), "expected a line of comment (`** ...`) or an empty one before mode 1 of 2"},
      {replaced(kRod, "** mode 1\n", "** mode 1\n** again\n"), "found a line that begins with `**`"},
      {replaced(kRod, "2. 0. 0. 3.", "-2. 0. 0. 3."), "the modal mass of mode 1 is -2"},
      {replaced(kRod, "2. 2. 2. 0.01", "-2. 2. 2. 0.01"), "node 2 has a negative mass, -2"},
      {replaced(kRod, "** RECORD GROUP 1, HEADER", "** RECORD GROUP 3"), "comes before record group 1"},
      {replaced(kRod, "** RECORD GROUP 1, HEADER", "** Record Group 1"), "this line is no heading of a record"},
      {kRod.substr(0, kRod.size() / 2), "has to have 24 numbers for 2 nodes and 2 modes, but the file ends after"},
      {"", "record group 1 (header) is missing"},
  };
  for (const auto& [text, told] : cases) {
    const std::string complaint = fem_complaint(text);
    INFO(complaint);
    CHECK(complaint.find(told) != std::string::npos);
  }
}

TEST_CASE("modal joint: what the card takes from the file") {
  SECTION("damping from the file without a keyword, modes in their order") {
    const ModalData data = read_card("1, 2, from file, \"rod.fem\", " + kInterface);
    CHECK(data.coordinates() == 2);
    CHECK(data.C(0, 1) == 0.5);
    CHECK(data.interfaces.front().Q(2, 1) == 1.5);
    CHECK(data.inertia.m == 3.0);
    CHECK(data.inertia.S0 == Vec3(2.0, 0.0, 0.0));
    CHECK(data.inertia.I3(1, 1) == 2.0);
  }
  SECTION("one listed mode, its initial value, no damping") {
    const ModalData data =
        read_card("1, 1, list, 2, initial value, mode, 2, 0.5, 0.25, 2, no damping, \"rod.fem\", 1, \"102\", 2, null");
    CHECK(data.numbers == std::vector<int>{2});
    CHECK(data.K(0, 0) == 400.0);
    CHECK(data.C(0, 0) == 0.0);
    CHECK(data.a(0) == 0.5);
    CHECK(data.b(0) == 0.25);
  }
  SECTION("damping by ratios, by mass and stiffness") {
    const double first = 2.0 * std::sqrt(300.0 * 2.0), second = 2.0 * std::sqrt(400.0 * 3.0);
    CHECK(read_card("1, 2, from file, single factor damping, 0.1, \"rod.fem\", 0").C(1, 1) == Approx(0.1 * second));
    CHECK(read_card("1, 2, from file, proportional damping, 0.1, \"rod.fem\", 0").C(0, 0) == Approx(0.1 * first));
    const ModalData data = read_card("1, 2, from file, diag damping, 1, 2, 0.3, \"rod.fem\", 0");
    CHECK(data.C(0, 0) == 0.0);
    CHECK(data.C(1, 1) == Approx(0.3 * second));
    const ModalData all = read_card("1, 2, from file, diag damping, all, 0.2, 0.3, \"rod.fem\", 0");
    CHECK(all.C(0, 0) == Approx(0.2 * first));
    const ModalData rayleigh = read_card("1, 2, from file, rayleigh damping, 0.5, 0.01, \"rod.fem\", 0");
    CHECK(rayleigh.C(0, 1) == Approx(0.01));
    CHECK(rayleigh.C(0, 0) == Approx(0.5 * 2.0 + 0.01 * 300.0));
  }
  SECTION("origin, thresholds, options without effect") {
    const ModalData data = read_card(
        "1, 2, from file, no damping, \"rod.fem\", stiffness threshold, 350., create binary, echo, \"x\", precision, "
        "3, "
        "origin node, A, 1, output, yes, A, 2, 0.1, 0.2, 0.3, orientation, eye, output, yes, use invariant 9");
    CHECK(data.K(0, 0) == 0.0);
    CHECK(data.K(1, 1) == 400.0);
    CHECK(data.interfaces.front().o == Vec3(0.1, 0.2, 0.3));
    CHECK(data.inertia.I9.size() == 4);
    const ModalData moved = read_card("1, 2, from file, \"rod.fem\", origin position, 0.5, 0., 0., " + kInterface);
    CHECK(moved.interfaces.front().p == Vec3(0.5, 0.0, 0.0));
    CHECK(moved.inertia.S0 == Vec3(0.5, 0.0, 0.0));
  }
  SECTION("closest node, clamped body") {
    const ModalData data = read_card(
        "clamped, position, 0.25, 0., 0., orientation, eye, 2, from file, \"rod.fem\", 1, interface tolerance, 0.3, "
        "find closest, 2, null");
    CHECK_FALSE(data.node);
    CHECK(data.interfaces.front().label == "102");
    CHECK(data.x == Vec3(0.25, 0.0, 0.0));
  }
  SECTION("rigid inertia of record group 12 about the origin") {
    const std::string fem =
        replaced(kRod, "** RECORD GROUP 11, LUMPED MASSES\n1. 1. 1. 0.01 0.01 0.01\n2. 2. 2. 0.01 0.02 0.03\n",
                 "** RECORD GROUP 12\n4. 0.5 0. 0. 1. 0. 0. 0. 2. 0. 0. 0. 3.\n");
    const ModalData data = read_card("1, 2, from file, \"rod.fem\", 0", fem);
    CHECK(data.inertia.m == 4.0);
    CHECK(data.inertia.J0(2, 2) == Approx(3.0 + 4.0 * 0.25));
    CHECK_FALSE(data.inertia.coupled);
  }
}

TEST_CASE("modal joint: initial values by position go where MBDyn puts them") {
  const Files files;
  const ReadResult result = read_deck_text(
      modal_deck("1, 2, initial value, 0.1, 0.2, 0.3, 0.4, from file, \"rod.fem\", 0").text(), files.deck());
  REQUIRE(result.deck.has_value());
  const auto& data = result.deck->joints.front().as<ModalData>();
  CHECK(data.a == Eigen::Vector2d(0.3, 0.0));
  CHECK(messages(result).find("the first mode takes the last pair") != std::string::npos);
}

TEST_CASE("modal joint: cards that cannot be obeyed") {
  const std::string tail = ", from file, \"rod.fem\", " + kInterface;
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"2, 2" + tail, "is no modal node"},
      {"7, 2" + tail, "node 7 is not defined"},
      {"1, 3" + tail, "found 3 modes, the file `rod.fem` has 2"},
      {"1, 0" + tail, "found 0 modes"},
      {"1, 2, list, 2, 1" + tail, "ascending order"},
      {"1, 1, list, 3" + tail, "found mode 3, the file `rod.fem` has 2 modes"},
      {"1, 1, initial value, mode, 2, 0., 0." + tail, "which is not in use here"},
      {"1, 2, 3, \"rod.fem\", " + kInterface, "found 3 finite element nodes, the file `rod.fem` has 2"},
      {"1, 2, from file, \"none.fem\", " + kInterface, "the file `none.fem` cannot be read: no such file"},
      {"1, 2, from file, diag damping, 1, 3, 0.1, \"rod.fem\", 0", "found mode 3, expected 1 to 2"},
      {"1, 2, from file, \"rod.fem\", 1, B, 2, null", "found the node `B`"},
      {"1, 2, from file, \"rod.fem\", 1, 102, 1, null", "the modal node that carries the body"},
      {"1, 2, from file, \"rod.fem\", 1, find closest, 2, 0.1, 0., 0.", "m away, the tolerance is"},
      {"1, 2, from file, \"rod.fem\", 3, 102, 2, null", "found 3 interface nodes"},
      {"1, 2, from file, \"rod.fem\", 2, 102, 2, null", "interface node 2 of 2"},
      {"1, 2, from file, \"rod.fem\", use invariant 9, 0", "unknown name `use`"},
  };
  for (const auto& [card, told] : cases) {
    const std::string complaint = card_complaint(card);
    INFO(card << "\n" << complaint);
    CHECK(complaint.find(told) != std::string::npos);
  }
  const std::string damaged = card_complaint("1, 2" + tail, "", replaced(kRod, "400.", "inf"));
  INFO(damaged);
  CHECK(damaged.find("rod.fem:24:") != std::string::npos);
  const std::string no_damping = card_complaint("1, 2, from file, damping from file, \"rod.fem\", 0", "",
                                                replaced(kRod, "** RECORD GROUP 13", "** RECORD GROUP 19"));
  CHECK(no_damping.find("needs record group 13") != std::string::npos);
}

TEST_CASE("forces on modal equations") {
  const std::string card = "1, 2, from file, \"rod.fem\", 0";
  const Files files;
  const ReadResult result = read_deck_text(
      modal_deck(card, "force: 1, modal, 5, const, 3., const, 4.;\nforce: 2, modal, 5, list, 1, 2, const, 7.;\n")
          .text(),
      files.deck());
  INFO(messages(result));
  REQUIRE(result.deck.has_value());
  CHECK(result.deck->forces[0].as<ModalForceData>().terms.size() == 2);
  const auto& listed = result.deck->forces[1].as<ModalForceData>();
  REQUIRE(listed.terms.size() == 1);
  CHECK(listed.terms.front().mode == 1);
  CHECK(listed.terms.front().drive->value(0.0) == 7.0);

  CHECK(card_complaint(card, "force: 1, modal, 5, const, 3.;\n").find("the drive of mode 2") != std::string::npos);
  CHECK(card_complaint(card, "force: 1, modal, 6, const, 3.;\n").find("joint 6 is not defined") != std::string::npos);
  CHECK(card_complaint(card, "force: 1, modal, 5, list, 1, 3, const, 3.;\n").find("found mode 3") != std::string::npos);
}
