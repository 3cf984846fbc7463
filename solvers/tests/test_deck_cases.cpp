// The reference decks, include files, files that are not decks, and the time it takes.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>

#include "test_deck_support.h"

namespace fs = std::filesystem;
using deck_test::messages;
using mbdae::Vec3;

namespace {

/// A directory of its own, removed at the end.
class Directory {
 public:
  Directory() : path_(fs::temp_directory_path() / ("mbdae_deck_test_" + std::to_string(::getpid()))) {
    fs::create_directories(path_);
  }
  ~Directory() { fs::remove_all(path_); }
  std::string write(const std::string& name, const std::string& text) const {
    fs::create_directories((path_ / name).parent_path());
    std::ofstream(path_ / name, std::ios::binary) << text;
    return (path_ / name).string();
  }
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

std::string file_complaint(const std::string& path) {
  const mbdae::ReadResult result = mbdae::read_deck_file(path);
  CHECK_FALSE(result.deck.has_value());
  return messages(result);
}

}  // namespace

TEST_CASE("every reference deck reads without a word") {
  int count = 0;
  for (const auto& entry : fs::directory_iterator(TEST_DATA_DIR "/mbdyn_cases")) {
    if (entry.path().extension() != ".mbd") continue;
    const mbdae::ReadResult result = mbdae::read_deck_file(entry.path().string());
    INFO(entry.path() << "\n" << messages(result));
    CHECK(result.deck.has_value());
    CHECK(result.diagnostics.empty());
    ++count;
  }
  CHECK(count >= 22);
}

TEST_CASE("the arm is the arm") {
  const mbdae::Deck deck = *mbdae::read_deck_file(TEST_DATA_DIR "/mbdyn_cases/arm_right.mbd").deck;
  REQUIRE(deck.nodes.size() == 6);
  REQUIRE(deck.joints.size() == 33);
  CHECK(deck.nodes[5].id.name == "hand");
  CHECK(deck.joints[7].id.name == "j_grip");
  CHECK(deck.joints[8].id.name == "joint 201");
  // Every rod has the length it says, its ends being where the nodes put them.
  int rods = 0;
  for (const mbdae::ElementData& joint : deck.joints) {
    const auto* rod = joint.get_if<mbdae::RodData>();
    if (rod == nullptr) continue;
    const auto end = [&](std::size_t node, const Vec3& f) { return Vec3(deck.nodes[node].x + deck.nodes[node].R * f); };
    CHECK((end(rod->node2, rod->f2) - end(rod->node1, rod->f1)).norm() == Approx(rod->L0).epsilon(1e-12));
    ++rods;
  }
  CHECK(rods == 25);
  const auto& grip = deck.joints[7].as<mbdae::TotalJointData>();
  const mbdae::Mat3 difference = deck.nodes[grip.node1].R * grip.R1hr - deck.nodes[grip.node2].R * grip.R2hr;
  CHECK(difference.cwiseAbs().maxCoeff() < 1e-14);
  CHECK(deck.gravity->at(0.0) == Vec3(0, -9.81, 0));
  CHECK(deck.initial_value.derivatives_coefficient == 1.0);
}

TEST_CASE("the pins of the total joint case hold") {
  const mbdae::Deck deck = *mbdae::read_deck_file(TEST_DATA_DIR "/mbdyn_cases/c07_total.mbd").deck;
  const auto& joint = deck.joints[1].as<mbdae::TotalJointData>();
  const auto& n1 = deck.nodes[joint.node1];
  const auto& n2 = deck.nodes[joint.node2];
  const Vec3 relative = (n1.R * joint.R1h).transpose() * (n2.x + n2.R * joint.f2 - n1.x - n1.R * joint.f1);
  const Vec3 imposed = joint.position_drive.at(0.0);
  CHECK(std::abs(relative(0) - imposed(0)) < 1e-14);
  CHECK(std::abs(relative(2) - imposed(2)) < 1e-14);
}

TEST_CASE("include files are relative to the file that includes them") {
  const Directory directory;
  deck_test::DeckText deck;
  deck.globals = "include: \"parts/outer.mbd\";\n";
  deck.elements = "body: 1, 1, MASS, null, eye;\n";
  directory.write("parts/outer.mbd", "include: \"inner.mbd\"; set: const real MASS = 2.*HALF;\n");
  directory.write("parts/inner.mbd", "set: const real HALF = 3.;");
  const std::string path = directory.write("deck.mbd", deck.text());
  const mbdae::ReadResult result = mbdae::read_deck_file(path);
  INFO(messages(result));
  REQUIRE(result.deck.has_value());
  CHECK(result.deck->bodies[0].m == 6.0);
  REQUIRE(result.deck->files.size() == 3);
  CHECK(fs::path(result.deck->files[1]).filename() == "outer.mbd");
  CHECK(fs::path(result.deck->files[2]).filename() == "inner.mbd");

  directory.write("parts/inner.mbd", "set: const real HALF = 3.*X;");
  const std::string inner = (directory.path() / "parts/inner.mbd").string();
  CHECK(file_complaint(path) == inner + ":1:27: error: unknown name `X`\n");
  directory.write("parts/inner.mbd", "\ninclude: \"../parts/outer.mbd\";");
  CHECK(file_complaint(path).find(":2:10: error: include loop: ") != std::string::npos);
}

TEST_CASE("what is not a deck is refused in one line") {
  const Directory directory;
  const std::string missing = (directory.path() / "missing.mbd").string();
  CHECK(file_complaint(missing) == missing + ": error: no such file\n");
  const std::string folder = directory.path().string();
  CHECK(file_complaint(folder) == folder + ": error: this is a directory, expected a deck\n");
  const std::string binary = directory.write("binary", std::string("\x7f"
                                                                   "ELF\0\0",
                                                                   6));
  CHECK(file_complaint(binary) ==
        binary + ": error: this is a binary file (it has zero bytes), expected a deck in plain text\n");
  const std::string empty = directory.write("empty", "");
  CHECK(file_complaint(empty) == empty + ":1:1: error: the file ends here, expected `begin: data;`\n");
  CHECK(file_complaint("/dev/zero") == "/dev/zero: error: this is a device or a socket, expected a regular file\n");
}

TEST_CASE("errors are told together, up to a limit") {
  deck_test::DeckText deck;
  for (int i = 0; i < 100; ++i) deck.elements += "joint: " + std::to_string(i) + ", clamp, 99, node, node;\n";
  const mbdae::ReadResult result = mbdae::read_deck_text(deck.text(), "test.mbd");
  REQUIRE(result.diagnostics.size() == 51);
  CHECK(result.diagnostics[49].format() == "test.mbd:63:19: error: node 99 is not defined before this card");
  CHECK(result.diagnostics[50].format() == "test.mbd: error: stopped reading after 50 errors: correct these first");
}

TEST_CASE("one mistake is told once") {
  deck_test::DeckText deck;
  deck.globals =
      "set: const real A = 1./0.; set: const real B = 2.*A;\nreference: 4, B, 0., 0., eye, null, null;\n"
      "constitutive law: 1, 1, linear elastic, B; drive caller: 3, const, B;";
  deck.nodes =
      "structural: 1, dynamic, reference, 4, null, eye, null, null;\nstructural: 2, dynamic, 1., 0., 0., eye, null, "
      "null;\n";
  deck.elements =
      "joint: 1, rod, 1, 2, from nodes, reference, 1;\njoint: 2, rod, 2, 1, from nodes, reference, 1;\n"
      "body: 1, 2, B, null, eye;\nforce: 1, absolute, 2, position, null, 1., 0., 0., reference, 3;\n";
  CHECK(deck_test::complaint(deck.text()) == "test.mbd:8:23: error: division by zero\n");
}

TEST_CASE("a deck of the size of the arm reads in less than a millisecond of processor time") {
  const std::string text = deck_test::load(TEST_DATA_DIR "/mbdyn_cases/arm_right.mbd");
  const int repetitions = 50;
  double best = 1.0;
  for (int trial = 0; trial < 5; ++trial) {
    const std::clock_t begin = std::clock();
    for (int i = 0; i < repetitions; ++i) mbdae::read_deck_text(text, "arm.mbd");
    best = std::min(best, static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC / repetitions);
  }
  std::printf("reading %zu characters: %.0f us\n", text.size(), 1e6 * best);
#ifdef NDEBUG
  CHECK(best < 1e-3);
#else
  CHECK(best < 20e-3);
#endif
}
