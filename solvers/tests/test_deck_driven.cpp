// Driven elements, file drivers, imposed rotation, laws of two stiffnesses, cards that MBDyn's users write around them.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "mbdae/dae/analyses.h"
#include "tangent_check.h"
#include "test_deck_support.h"

using namespace mbdae;
using Catch::Contains;
using deck_test::DeckText;

namespace {

/// A directory of its own for files that decks name; gone afterwards.
class Files {
 public:
  Files() {
    std::string name = (std::filesystem::temp_directory_path() / "mbdae-XXXXXX").string();
    REQUIRE(mkdtemp(name.data()) != nullptr);
    path_ = name;
  }
  ~Files() {
    std::error_code error;
    std::filesystem::remove_all(path_, error);
  }
  void write(const std::string& name, const std::string& text) const {
    std::filesystem::create_directories((path_ / name).parent_path());
    std::ofstream(path_ / name) << text;
  }
  std::string deck() const { return (path_ / "deck.mbd").string(); }

 private:
  std::filesystem::path path_;
};

/// A force on the first node with this drive.
std::string force(const std::string& drive) {
  return "force: 1, absolute, 1, position, null, 1., 0., 0., " + drive + ";\n";
}

/// The text of a deck with a block of drivers.
std::string driver_deck(const std::string& driver, const std::string& drive, int announced = 1) {
  DeckText deck;
  deck.control = "file drivers: " + std::to_string(announced) + ";";
  deck.elements = force(drive);
  std::string text = deck.text();
  const std::string nodes = "end: nodes;\n";
  return text.insert(text.find(nodes) + nodes.size(), "begin: drivers; " + driver + " end: drivers;\n");
}

DrivePtr file_drive(const Files& files, const std::string& driver, const std::string& drive) {
  const ReadResult result = read_deck_text(driver_deck(driver, drive), files.deck());
  INFO(deck_test::messages(result));
  REQUIRE(result.deck.has_value());
  return result.deck->forces[0].as<ForceData>().value.terms[0].drive;
}

std::string file_complaint(const Files& files, const std::string& driver, const std::string& drive = "file, 1") {
  const ReadResult result = read_deck_text(driver_deck(driver, drive), files.deck());
  REQUIRE_FALSE(result.deck.has_value());
  return deck_test::messages(result);
}

double at_end(const Motion& motion, const std::string& name) {
  for (std::size_t i = 0; i < motion.channels.size(); ++i) {
    if (motion.channels[i].name == name) return motion.data(motion.data.rows() - 1, static_cast<Eigen::Index>(i));
  }
  FAIL("no channel " + name);
  return 0.0;
}

Motion integrated(const Deck& deck, const char* integrator) {
  IntegrateOptions options;
  options.integrator = integrator;
  return integrate(deck, options);
}

}  // namespace

TEST_CASE("file drives: times of their own or in steps, lines or constants") {
  const Files files;
  files.write("steps.txt", "# initial time: 1.\n# time step: 0.5\n1. 10.\n3. 20.\n\n2. 30.\n");
  files.write("data/times.txt", "0. 1.\n1. 3.\n4. -3.\n");
  const auto fixed =
      file_drive(files, "file: 1, fixed step, count, 2, initial time, from file, time step, from file, \"steps.txt\";",
                 "file, 1, 2, amplitude, 2.");
  CHECK(fixed->value(1.0) == 20.0);
  CHECK(fixed->value(1.25) == 30.0);
  CHECK(fixed->at(1.25).rate == 40.0);
  CHECK(fixed->value(2.0) == 60.0);
  CHECK(fixed->value(2.01) == 0.0);  // zero beyond the file, as MBDyn pads
  CHECK(fixed->value(0.99) == 0.0);
  const auto held = file_drive(files,
                               "file: 1, fixed step, 2, 2, initial time, 0., time step, 1., interpolation, const, pad "
                               "zeroes, no, \"steps.txt\";",
                               "file, 1");
  CHECK(held->value(-1.0) == 1.0);
  CHECK(held->value(0.9) == 1.0);
  CHECK(held->value(7.0) == 3.0);
  const auto free = file_drive(files, "chdir: \"data\"; file: 1, variable step, 1, \"times.txt\";",
                               "array, 2, file, 1, 1, const, 1.");
  CHECK(free->value(0.5) == 3.0);
  CHECK(free->value(2.5) == 1.0);
  CHECK(free->at_argument(99.0, 2.5).value == 1.0);  // the file's time is the time, whatever the drive stands in
  std::vector<double> jumps;
  free->known_jumps(jumps);
  CHECK(jumps == std::vector<double>{0.0, 1.0, 4.0});
}

TEST_CASE("what is wrong with a file driver is told") {
  const Files files;
  files.write("bad.txt", "0. 1.\n1. x\n");
  files.write("short.txt", "0. 1.\n1.\n");
  files.write("back.txt", "0. 1.\n0. 2.\n");
  files.write("many.txt", "0. 1. 2.\n");
  files.write("empty.txt", "# nothing\n");
  const auto variable = [&](const std::string& name) {
    return file_complaint(files, "file: 1, variable step, 1, \"" + name + "\";");
  };
  CHECK_THAT(variable("bad.txt"), Contains("`bad.txt`, line 2: found `x`, expected number 2 of 2"));
  CHECK_THAT(variable("short.txt"), Contains("line 2: the line ends, expected number 2 of 2"));
  CHECK_THAT(variable("back.txt"), Contains("found time 0 after 0, expected increasing times"));
  CHECK_THAT(variable("many.txt"), Contains("line 1: found more than 2 numbers (time included)"));
  CHECK_THAT(variable("empty.txt"), Contains("has no numbers"));
  CHECK_THAT(variable("none.txt"), Contains("cannot be read: no such file"));
  CHECK_THAT(file_complaint(files, "file: 1, fixed step, 5, 2, initial time, 0., time step, 1., \"bad.txt\";"),
             Contains("found `x`"));
  CHECK_THAT(file_complaint(files, "file: 1, fixed step, 5, 1, initial time, 0., time step, 1., \"empty.txt\";"),
             Contains("has no numbers"));
  CHECK_THAT(
      file_complaint(files, "file: 1, fixed step, count, 3, initial time, from file, time step, 1., \"many.txt\";"),
      Contains("does not give the initial time"));
  CHECK_THAT(file_complaint(files, "file: 1, variable step, 2, \"many.txt\";", "file, 1, 3"),
             Contains("found column 3, expected 1 to 2"));
  CHECK_THAT(file_complaint(files, "file: 1, variable step, 2, \"many.txt\";", "file, 2"),
             Contains("file driver 2 is not defined"));
  CHECK_THAT(file_complaint(files, "file: 1, variable step, 2, bailout, any, \"many.txt\";"),
             Contains("not supported: the option `bailout`"));
  CHECK_THAT(file_complaint(files, "file: 1, stream, 2;"), Contains("not supported: the file driver `stream`"));
  const ReadResult counted =
      read_deck_text(driver_deck("file: 1, variable step, 2, \"many.txt\";", "1.", 2), files.deck());
  CHECK_THAT(deck_test::messages(counted), Contains("announce 2 file drivers, the deck has 1"));
  const std::string in_string = driver_deck("file: 1, variable step, 2, \"many.txt\"; drive caller: 7, file, 1, 2;",
                                            "string, \"model::drive(7, Time)\"");
  CHECK_THAT(deck_test::messages(read_deck_text(in_string, files.deck())),
             Contains("not supported: a drive that reads a file within a string"));
}

TEST_CASE("a force from a file moves a mass") {
  const Files files;
  files.write("force.txt", "0. 0.\n0.35 7.\n0.5 7.\n");  // rises, stays, ends
  const std::string text = driver_deck("file: 1, variable step, 1, \"force.txt\";", "file, 1, 1");
  std::string deck = text;
  const std::size_t extra = deck.find("structural: 2");
  deck.erase(extra, deck.find('\n', extra) + 1 - extra);
  deck.replace(deck.find("structural nodes: 2"), 19, "structural nodes: 1");
  deck.replace(deck.find("rigid bodies: 0"), 15, "rigid bodies: 1");
  deck.replace(deck.find("force: 1,"), 9, "body: 1, 1, 2., null, eye; force: 1,");
  const ReadResult result = read_deck_text(deck, files.deck());
  INFO(deck_test::messages(result));
  REQUIRE(result.deck.has_value());
  const Motion motion = integrated(*result.deck, "ida");
  CHECK(at_end(motion, "node 1.vx") == Approx(0.5 * (0.5 * 0.35 * 7.0 + 0.15 * 7.0)).epsilon(1e-8));
}

TEST_CASE("the tangents of imposed rotation are exact") {
  test::Ugly ugly(31);
  Deck deck;
  for (int i = 0; i < 2; ++i) {
    const NodeIndex node =
        test::add_node(deck, NodeKind::dynamic_node, ugly.vector(), ugly.rotation(), ugly.vector(), ugly.vector());
    test::add_body(deck, node, 1.5 + i, ugly.vector(0.1), ugly.inertia());
  }
  test::add_joint(deck, AxialRotationData{0, 1, ugly.vector(), ugly.vector(), ugly.rotation(), ugly.rotation(),
                                          test::sine(2.0, 0.3, 3.0)});
  test::add_joint(deck, RevoluteRotationData{0, 1, ugly.rotation(), ugly.rotation()});
  test::add_joint(deck, CardanoRotationData{1, 0, ugly.rotation(), ugly.rotation()});
  test::check_tangents(deck, 32);
}

TEST_CASE("an axial rotation spins as its drive says") {
  DeckText deck;
  deck.initial = "initial time: 0.; final time: 2.; time step: 0.01; method: ms, 0.6; tolerance: 1.e-9;\n";
  deck.nodes = "structural: 1, static, null, eye, null, null; structural: 2, dynamic, null, eye, null, null;\n";
  deck.elements =
      "joint: 1, clamp, 1, node, node; body: 2, 2, 1., 0.1, 0., 0., diag, 0.1, 0.2, 0.3;\n"
      "joint: 2, axial rotation, 1, position, null, 2, position, null, ramp, 1.5, 0., 1., 0.;\n";
  for (const char* integrator : {"ida", "ms"}) {
    INFO(integrator);
    const Motion motion = integrated(deck_test::read_good(deck), integrator);
    CHECK(at_end(motion, "node 2.wz") == Approx(1.5).epsilon(1e-8));
    CHECK(at_end(motion, "node 2.gz") == Approx(2.25).epsilon(integrator == std::string("ida") ? 1e-7 : 1e-4));
    // the centre of mass on its circle
    CHECK(at_end(motion, "joint 2.reaction[1]") == Approx(-1.5 * 1.5 * 0.1 * std::cos(2.25)).epsilon(2e-4));
  }
  deck.elements.replace(deck.elements.rfind("ramp, 1.5"), 9, "node, 1, ");
  CHECK_FALSE(deck_test::complaint(deck.text()).empty());
}

TEST_CASE("driven elements are there while their drive is not zero") {
  DeckText deck;
  deck.initial = "initial time: 0.; final time: 1.; time step: 0.01; method: ms, 0.6; tolerance: 1.e-9;\n";
  deck.nodes = "structural: 1, dynamic, null, eye, null, null;\n";
  deck.elements =
      "body: 1, 1, 2., null, eye; gravity: uniform, 1., 0., 0., const, 2.;\n"
      "driven: 3, string, \"Time < 0.4055\", joint: 3, spherical pin, 1, position, null, position, null;\n"
      "driven: 7, step, 0.7, 1., 0., force: 7, absolute, 1, position, null, 1., 0., 0., const, 6.;\n";
  const Deck read = deck_test::read_good(deck);
  CHECK(read.joints.size() == 1);
  REQUIRE(read.joints[0].driver);
  const Motion motion = integrated(read, "ida");
  CHECK(motion.notes.empty());
  CHECK(at_end(motion, "node 1.vx") == Approx(2.0 * (1.0 - 0.4055) + 3.0 * 0.3).epsilon(1e-8));
  CHECK(at_end(motion, "joint 3.reaction[1]") == Approx(0.0).margin(1e-9));
  CHECK(motion.data(10, 0) == Approx(0.0).margin(1e-12));
  CHECK(at_end(integrated(read, "ms"), "node 1.vx") == Approx(2.0 * 0.59 + 3.0 * 0.3).epsilon(0.02));

  // one that already is there; its matrices are those of a deck without it but for the reactions
  deck.elements =
      "body: 1, 1, 2., null, eye; joint: 3, spherical pin, 1, position, null, position, null;\n"
      "driven: 3, 0., existing: joint, 3;\n";
  const LinearisedModel gone = linearise(deck_test::read_good(deck), {});
  CHECK((gone.J_plus.block<3, 3>(12, 12) - gone.c * Mat3::Identity()).isZero(1e-15));
  CHECK(gone.J_plus.block<3, 12>(12, 0).isZero(0.0));
  CHECK(gone.J_plus.block<12, 3>(0, 12).isZero(0.0));
  test::check_tangents(deck_test::read_good(deck), 41);
  deck.elements.replace(deck.elements.rfind("0., existing"), 2, "3.");
  test::check_tangents(deck_test::read_good(deck), 42);
}

TEST_CASE("what cannot be driven is refused") {
  DeckText deck;
  const auto complaint = [&](const std::string& elements) {
    deck.elements = elements;
    return deck_test::complaint(deck.text());
  };
  CHECK_THAT(complaint("driven: 1, 1., body: 1, 1, 2., null, eye;\n"), Contains("not supported: a driven `body`"));
  CHECK_THAT(complaint("driven: 1, 1., joint: 2, spherical hinge, 1, position, null, 2, position, null;\n"),
             Contains("has the label 2, expected 1"));
  CHECK_THAT(complaint("driven: 1, 1., joint: 1, distance, 1, position, null, 2, position, null, 1.;\n"),
             Contains("not supported: a driven distance, which has unknowns of its own"));
  CHECK_THAT(complaint("driven: 1, 1., existing: joint, 1;\n"), Contains("joint 1 is not defined"));
  CHECK_THAT(complaint("driven: 1, 1., joint, 1, clamp, 1, node, node;\n"),
             Contains("without a colon, expected `joint: ...`"));
  CHECK_THAT(complaint("driven: 1, 1.;\n"), Contains("expected the driven element"));
  CHECK_THAT(complaint("driven: 1, 1., joint: 1, clamp, 1, node, node, 3.;\n"), Contains("expected `;`"));
}

TEST_CASE("two stiffnesses, functions of the strain") {
  DeckText deck;
  deck.globals = "scalar function: \"f\", multilinear, 0., 0., 1., 2., 2., 6., end;\n";
  const auto law = [&](const std::string& text) {
    deck.elements = "joint: 1, rod, 1, 2, 1., " + text + ";\n";
    return deck_test::only_joint<RodData>(deck_test::read_good(deck)).law;
  };
  const Law1 two = law("double linear elastic, 10., 0.5, -0.25, 30., prestress, 1.");
  const std::pair<double, double> points[] = {{0.0, 1.0}, {0.5, 6.0}, {0.6, 9.0}, {-0.25, -1.5}, {-0.35, -4.5}};
  for (const auto& [strain, value] : points) CHECK(evaluate(two, 0.0, strain, 7.0).f == Approx(value));
  CHECK(evaluate(two, 0.0, 0.6, 0.0).k == Approx(30.0));
  CHECK(evaluate(law("double linear viscoelastic, 10., 0.5, -0.25, 30., 2."), 0.0, 0.6, 7.0).f == Approx(22.0));
  CHECK(evaluate(law("scalar function elastic isotropic, \"f\", prestrain, 0.5"), 0.0, 2.0, 0.0).f == Approx(4.0));
  const auto complaint = [&](const std::string& text) {
    deck.elements = "joint: 1, rod, 1, 2, 1., " + text + ";\n";
    return deck_test::complaint(deck.text());
  };
  CHECK_THAT(complaint("double linear elastic, 10., -0.5, 0.25, 30."), Contains("expected one below the upper, -0.5"));
  CHECK_THAT(complaint("scalar function elastic, \"g\""), Contains("\"g\""));
  deck.elements = "joint: 1, deformable hinge, 1, 2, scalar function elastic orthotropic, \"f\", null, \"f\";\n";
  const Law3 three = deck_test::only_joint<DeformableHingeData>(deck_test::read_good(deck)).law;
  CHECK(evaluate(three, 0.0, Vec3(0.5, 1.0, 2.0), Vec3::Zero()).f == Vec3(1.0, 0.0, 6.0));
}

TEST_CASE("cards around a model") {
  DeckText deck;
  deck.initial +=
      "strategy: factor, .5, 2, 2., 2, 2, 5; enforce constraint equations: constraint violations, scale factor, 0.5;\n";
  deck.globals = "chdir: \".\"; setenv: \"MBVAR=1\"; setenv: overwrite, yes, \"A=2\"; set: real Q = Time;\n";
  deck.nodes += "structural: 3, dummy, 1, relative frame, 2, position, 1., 0., 0., pivot node, 2;\n";
  deck.nodes.replace(0, deck.nodes.find('\n'), "structural: 1, dynamic, null, euler, 0., 0., pi/2, null, null;");
  deck.elements = "force: 1, absolute, 1, position, null, single, reference, node, 1., 0., 0., const, 3.;\n";
  const ReadResult result = read_deck_text(deck.text(), "test.mbd");
  REQUIRE(result.deck.has_value());
  CHECK_THAT(deck_test::messages(result), Contains("the strategy has no effect"));
  CHECK_THAT(deck_test::messages(result), Contains("`Time` is the initial time"));
  CHECK((result.deck->forces[0].as<ForceData>().value.at(0.0) - Vec3(0.0, 3.0, 0.0)).norm() < 1e-15);
  REQUIRE(result.deck->dummy_nodes.size() == 1);
  CHECK(result.deck->dummy_nodes[0].relative_to == NodeIndex{1});
  deck.globals = "chdir: \"no such directory\";\n";
  CHECK_THAT(deck_test::complaint(deck.text()), Contains("there is no directory `no such directory`"));
  deck.globals = "setenv: \"=\";\n";
  CHECK_THAT(deck_test::complaint(deck.text()), Contains("expected \"NAME=VALUE\""));
  deck.globals.clear();
  deck.initial += "strategy: sometimes;\n";
  CHECK_THAT(deck_test::complaint(deck.text()), Contains("strategy `sometimes`"));
}

TEST_CASE("a deck of all these cards moves alike by both integrators") {
  const ReadResult result = read_deck_file(TEST_DATA_DIR "/deck_cards/cards.mbd");
  INFO(deck_test::messages(result));
  REQUIRE(result.deck.has_value());
  const Motion ida = integrated(*result.deck, "ida"), ms = integrated(*result.deck, "ms");
  CHECK(ida.notes.empty());
  for (const char* name : {"node 2.wz", "node 3.vx", "node 3.vy", "node 3.vz"}) {
    INFO(name);
    CHECK(at_end(ms, name) == Approx(at_end(ida, name)).margin(2e-3));
  }
  CHECK(at_end(ida, "node 3.vz") < -2.3);  // it falls from 0.255 s on, against a rod and a spring
  CHECK(at_end(ida, "joint 3.reaction[3]") == Approx(0.0).margin(1e-9));
}
