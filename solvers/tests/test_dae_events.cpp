// Integrations that end and start again: drives that jump, constraints that cease to be redundant; analyses on the way.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include "mbdae/dae/analyses.h"
#include "test_deck_support.h"

using namespace mbdae;

namespace {

Deck deck_of(const std::string& initial, const std::string& globals, const std::string& nodes,
             const std::string& elements) {
  deck_test::DeckText text;
  text.initial = initial;
  text.globals = globals;
  text.nodes = nodes;
  text.elements = elements;
  return deck_test::read_good(text);
}

std::size_t channel(const Motion& motion, const std::string& name) {
  for (std::size_t i = 0; i < motion.channels.size(); ++i) {
    if (motion.channels[i].name == name) return i;
  }
  FAIL("no channel " + name);
  return 0;
}

double at_end(const Motion& motion, const std::string& name) {
  return motion.data(motion.data.rows() - 1, static_cast<Eigen::Index>(channel(motion, name)));
}

const std::string kTimes = "initial time: 0.; final time: 1.; time step: 0.01; method: ms, 0.6; tolerance: 1.e-9;\n";

/// A mass of 2 kg on a total pin joint that leaves nothing free, imposed along x by the drive.
Deck imposed(const std::string& drive) {
  return deck_of(kTimes, "", "structural: 1, dynamic, null, eye, null, null;\n",
                 "body: 1, 1, 2., null, eye;\njoint: 1, total pin joint, 1, position constraint, 1, 1, 1, component, " +
                     drive + ", 0., 0., orientation constraint, 1, 1, 1, null;\n");
}

/// Bricard's mechanism (IFToMM library of benchmarks): a closed chain of rods of 1 m and 1 kg and six revolute hinges,
/// whose axes let it move although its constraints are as many as its freedoms.
Deck bricard() {
  std::string nodes, elements;
  const char* places[] = {".5,0.,0.", "1.,-.5,0.", "1.,-1.,.5", ".5,-1.,1.", "0.,-.5,1."};
  const char* inertia[] = {"j, J, J", "J, j, J", "J, J, j", "j, J, J", "J, j, J"};
  const auto hinge = [](int frame) {
    const std::string f = "reference, " + std::to_string(frame) + ", ";
    return "position, " + f + "null, orientation, " + f + "eye";
  };
  for (int i = 1; i <= 5; ++i) {
    const std::string n = std::to_string(i);
    nodes += "structural: " + n + ", dynamic, " + places[i - 1] + ", eye, null, null;\n";
    elements += "body: " + n + ", " + n + ", 1., null, diag, " + inertia[i - 1] + ";\n";
    if (i > 1) {
      elements += "joint: " + n + ", revolute hinge, " + std::to_string(i - 1) + ", " + hinge(i) + ", " + n + ", " +
                  hinge(i) + ";\n";
    }
  }
  elements += "joint: 1, revolute pin, 1, " + hinge(1) + ", " + hinge(1) + ";\n";
  elements += "joint: 6, revolute pin, 5, " + hinge(6) + ", " + hinge(6) + ";\n";
  elements += "gravity: uniform, 0., -1., 0., const, 9.81;\n";
  return deck_of("initial time: 0.; final time: 10.; time step: 0.05; method: ms, 0.6;\n",
                 "set: real J = 1./12.; set: real j = 1e-4;\n"
                 "reference: 1, null, euler, -pi/2., 0., 0., null, null;\n"
                 "reference: 2, 1.,0.,0., eye, null, null;\n"
                 "reference: 3, 1.,-1.,0., euler, 0., pi/2., 0., null, null;\n"
                 "reference: 4, 1.,-1.,1., euler, -pi/2., 0., 0., null, null;\n"
                 "reference: 5, 0.,-1.,1., eye, null, null;\n"
                 "reference: 6, 0.,0.,1., euler, 0., pi/2., 0., null, null;\n",
                 nodes, elements);
}

/// Kinetic and potential energy of `bricard` at a row [J].
double energy(const Deck& deck, const Motion& motion, Eigen::Index row) {
  double sum = 0.0;
  for (std::size_t i = 0; i < deck.nodes.size(); ++i) {
    const auto first = static_cast<Eigen::Index>(channel(motion, deck.nodes[i].id.name + ".x"));
    const Vec3 x = motion.data.row(row).segment<3>(first), g = motion.data.row(row).segment<3>(first + 3),
               v = motion.data.row(row).segment<3>(first + 6), w = motion.data.row(row).segment<3>(first + 9);
    const Mat3 R = rotation_exp(g);
    const BodyData& body = deck.bodies[i];
    sum += 0.5 * body.m * v.squaredNorm() + 0.5 * w.dot(R * body.J_cm * R.transpose() * w) + 9.81 * body.m * x(1);
  }
  return sum;
}

}  // namespace

TEST_CASE("a step of the force between two time steps is met") {
  for (const char* drive : {"step, 0.503, 3., 0.", "string, \"3.*step(Time - 0.503)\"", "string, \"3.*(Time > 0.503)\"",
                            "array, 2, ramp, 0., 0., 1., 0., step, 0.503, 3., 0."}) {
    INFO(drive);
    const Deck deck = deck_of(
        kTimes, "", "structural: 1, dynamic, null, eye, null, null;\n",
        "body: 1, 1, 2., null, eye;\nforce: 1, absolute, 1, position, null, 1., 0., 0., " + std::string(drive) + ";\n");
    const Motion motion = integrate(deck, {});
    CHECK(at_end(motion, "node 1.x") == Approx(0.5 * 1.5 * 0.497 * 0.497).epsilon(1e-8));
    CHECK(at_end(motion, "node 1.vx") == Approx(1.5 * 0.497).epsilon(1e-9));
  }
}

TEST_CASE("an imposed position that jumps is told and goes on") {
  const Motion motion = integrate(imposed("step, 0.5, 0.1, 0."), {});
  REQUIRE(motion.notes.size() == 1);
  CHECK(motion.notes[0].find("at t = 0.5 s a drive jumps: constraint 1 of 6 of joint 1 (total pin joint 1)") == 0);
  CHECK(at_end(motion, "node 1.x") == Approx(0.1).epsilon(1e-12));
  CHECK(motion.time.size() == 101);
  CHECK(motion.data(49, static_cast<Eigen::Index>(channel(motion, "node 1.x"))) == Approx(0.0).margin(1e-12));
}

TEST_CASE("constraints that begin to contradict are refused") {
  const char* const elements =
      "body: 1, 1, 1., null, diag, .1, .2, .3;\n"
      "joint: 1, spherical pin, 1, position, null, position, 0., 0., -1.;\n"
      "joint: 2, total pin joint, 1, position, null, position, 0., 0., -1., position constraint, 1, 1, 1, component, ";
  for (const char* drive :
       {"cosine, 0.5, 6.28, 0.05, one, 0.", "step, 0.5, 0.1, 0.", "string, \"0.05*ramp(Time - 0.5)^4\""}) {
    INFO(drive);
    const Deck deck = deck_of(kTimes, "", "structural: 1, dynamic, 0., 0., -1., eye, null, null;\n",
                              elements + std::string(drive) + ", 0., 0., orientation constraint, 1, 1, 1, null;\n");
    CHECK_THROWS_AS(integrate(deck, {}), NotConverged);
    CHECK_THROWS_WITH(integrate(deck, {}), Catch::Contains("at t = 0.") && Catch::Contains("contradicts the other"));
  }
}

TEST_CASE("a closed chain with a redundant constraint moves for ten seconds") {
  const Deck deck = bricard();
  const Motion motion = integrate(deck, {});
  REQUIRE(motion.time.size() == 201);
  CHECK(motion.notes.empty());
  double worst = 0.0;
  for (Eigen::Index row = 0; row < motion.data.rows(); ++row) {
    worst = std::max(worst, std::abs(energy(deck, motion, row) - energy(deck, motion, 0)));
  }
  CHECK(worst < 1e-5);  // of some 50 J that are exchanged
}

TEST_CASE("joints that do not quite meet are closed, and how far is told") {
  Deck deck = bricard();
  deck.nodes[2].x += Vec3(3e-7, 0.0, 0.0);
  deck.initial_value.final_time = 0.5;
  const Motion motion = integrate(deck, {});
  REQUIRE(motion.notes.size() == 1);
  CHECK(motion.notes[0].find("the joints do not quite meet at the start: constraint 1 of 5 of joint ") == 0);
  CHECK(motion.notes[0].find("3e-07 m") != std::string::npos);
}

TEST_CASE("a closed chain that cannot quite close moves, and what remains open is told") {
  Deck deck = bricard();
  deck.joints[1].as<RevoluteHingeData>().d2 += Vec3(5e-7, 0.0, 0.0);
  deck.initial_value.final_time = 1.0;
  const Motion motion = integrate(deck, {});
  REQUIRE(motion.notes.size() == 1);
  CHECK(motion.notes[0].find("constraint 1 of 5 of joint 3 (revolute hinge 3) is open by") != std::string::npos);
  CHECK(motion.notes[0].find("m or rad remain open") != std::string::npos);
  CHECK(std::abs(energy(deck, motion, motion.data.rows() - 1) - energy(deck, motion, 0)) < 1e-4);
}

TEST_CASE("velocities that the joints do not allow are replaced by the nearest") {
  Deck deck = bricard();
  deck.initial_value.final_time = 0.1;
  deck.nodes[0].v = Vec3(0.0, 0.5, 0.0);
  const Motion motion = integrate(deck, {});
  REQUIRE(motion.notes.size() == 1);
  CHECK(motion.notes[0].find("the initial velocities violate the constraints") == 0);
  deck.control.skip_initial_joint_assembly = true;
  CHECK_THROWS_AS(integrate(deck, {}), ModelError);
}

TEST_CASE("an eigenanalysis on the way sees the state of the time integration") {
  const std::string nodes = "structural: 1, dynamic, 1., 0., 0., eye, null, null;\n";
  const std::string elements =
      "body: 1, 1, 1., null, eye;\njoint: 1, spherical pin, 1, position, -1., 0., 0., position, null;\n"
      "gravity: uniform, 0., 0., -1., const, 9.81;\n";
  const auto analysed = [&](const std::string& when) {
    return deck_of(
        "initial time: 0.; final time: 1.; time step: 1e-3; method: ms, .6; tolerance: 1.e-9; eigenanalysis: " + when +
            ", parameter, 0.02;\n",
        "", nodes, elements);
  };
  const Deck deck = analysed("list, 4, 0., 0.5, 0.50049, 7.");
  const std::vector<LinearisedModel> models = linearise_at_times(deck, {});
  REQUIRE(models.size() == 4);  // 0.50049 s falls into the step to 0.501 s, 7 s is beyond the end
  CHECK(models[0].time == 0.0);
  CHECK(models[1].time == Approx(0.5).epsilon(1e-12));
  CHECK(models[2].time == Approx(0.501).epsilon(1e-12));
  CHECK(models[3].time == Approx(1.0).epsilon(1e-12));

  IntegrateOptions options;
  options.final_time = 0.5;
  options.rtol = 1e-10;
  const Motion motion = integrate(deck, options);
  CHECK(models[1].nodes[0].x(0) == Approx(at_end(motion, "node 1.x")).margin(2e-5));
  CHECK(models[1].nodes[0].w(1) == Approx(at_end(motion, "node 1.wy")).margin(2e-4));
  // The pendulum's momentum about its node: 1 kg m^2 about the centre of mass.
  CHECK(models[1].y(10) == Approx(models[1].nodes[0].w(1)).epsilon(1e-5));

  CHECK(linearise_at_times(analysed("0.5"), {}).size() == 1);
  CHECK(linearise_at_times(analysed("list, 2, 0.5001, 0.5002"), {}).size() == 1);  // in one step
}

TEST_CASE("drives that begin to contradict on the way are named") {
  const auto said = [](const std::string& joint, const char* integrator) {
    const Deck deck = deck_of(
        "initial time: 0.; final time: 1.; time step: 1e-2; method: ms, .6; tolerance: 1e-9; max iterations: 30;\n", "",
        "structural: 1, dynamic, null, eye, null, null;\nstructural: 2, static, 1., 0., 0., eye, null, null;\n",
        "body: 1, 1, 1., null, eye;\njoint: 3, clamp, 2, node, node;\n"
        "joint: 1, total pin joint, 1, position, null, position, null, position constraint, 1, 1, 1, null, "
        "orientation constraint, 1, 1, 1, null;\n" +
            joint);
    IntegrateOptions options;
    options.integrator = integrator;
    try {
      integrate(deck, options);
    } catch (const NotConverged& failure) {
      return std::string(failure.what());
    }
    return std::string("no failure");
  };
  const std::string pin =
      "joint: 2, total pin joint, 1, position, null, position, null, position constraint, 1, 0, 0, component, ";
  for (const char* integrator : {"ida", "ms"}) {
    INFO(integrator);
    for (const char* drive : {"ramp, 1., .5, forever, 0.", "sine, .2, 3., .1, forever, 0.", "step, .5, .1, 0."}) {
      INFO(drive);
      CHECK_THAT(said(pin + drive + ", null, null;\n", integrator),
                 Catch::Contains("joint 2 (total pin joint 2) is open by") && Catch::Contains("contradicts the other"));
      CHECK_THAT(said(std::string("joint: 2, distance, 1, 2, array, 2, 1., ") + drive + ";\n", integrator),
                 Catch::Contains("joint 2 (distance 2) is open by") && Catch::Contains("contradicts the other"));
    }
  }
}

TEST_CASE("absurd forces end soon, in a sentence that names them") {
  const auto said = [](const std::string& force) {
    const Deck deck = deck_of(
        "initial time: 0.; final time: 1.; time step: 1e-2; method: ms, .6;\n", "",
        "structural: 1, dynamic, null, eye, null, null;\nstructural: 2, dynamic, 1., 0., 0., eye, null, null;\n",
        "body: 1, 1, 1., null, eye;\nbody: 2, 2, 1., null, eye;\n"
        "joint: 1, spherical hinge, 1, position, 1., 0., 0., 2, position, null;\n"
        "force: 1, absolute, 1, position, 0.1, 0., 0., 0., 0., 1., " +
            force + ";\n");
    try {
      integrate(deck, {});
    } catch (const NotConverged& failure) {
      return std::string(failure.what());
    }
    return std::string("no failure");
  };
  const std::string advice = "look for a force, a stiffness or a mass that is wrong by orders of magnitude";
  for (const char* force : {"const, 1e30", "ramp, 1e30, 0., forever, 0.", "step, 0.5, 1e30, 0.", "const, 1e12"}) {
    INFO(force);
    CHECK_THAT(said(force), Catch::Contains(advice));
  }
  CHECK_THAT(said("const, 1e30"), Catch::Contains("node 1 is accelerated by"));
  CHECK_THAT(said("const, 1e12"), Catch::Contains(": 5000 steps did not reach the next instant to write: node"));
}

TEST_CASE("time steps without end are refused") {
  Deck deck = imposed("0.");
  deck.initial_value.time_step = 1e-25;
  for (const char* integrator : {"ida", "ms"}) {
    IntegrateOptions options;
    options.integrator = integrator;
    CHECK_THROWS_WITH(integrate(deck, options), Catch::Contains("more than 1e9 steps"));
  }
  deck.initial_value.time_step = 1e-9;
  CHECK_THROWS_WITH(integrate(deck, {}), Catch::Contains("more than 4 GB"));
  deck.initial_value.initial_time = 1e9;
  deck.initial_value.final_time = 1e9 + 1e-6;
  CHECK_THROWS_WITH(integrate(deck, {}), Catch::Contains("round-off"));
}

TEST_CASE("states are met at jumps and at later times like motions") {
  deck_test::DeckText text;
  text.initial =
      "initial time: 0.; final time: 1.; time step: 0.1; method: bdf; eigenanalysis: list, 2, 0., 0.75, parameter, "
      "0.02;\n";
  text.control = "abstract nodes: 1; genels: 1;";
  text.nodes = "structural: 1, dynamic, null, eye, null, null;\nabstract: 2, differential, value, 0.25;\n";
  text.elements =
      "body: 1, 1, 2., null, eye;\nforce: 1, absolute, 1, position, null, 1., 0., 0., step, 0.503, 3., 0.;\n"
      "genel: 1, spring support, 2, abstract, algebraic, linear viscous, 2.;\n"
      "force: 2, abstract, 2, abstract, step, 0.503, 3., 0.;\n";
  const Deck deck = deck_test::read_good(text);
  const Motion motion = integrate(deck, {});
  CHECK(at_end(motion, "node 1.x") == Approx(0.75 * 0.497 * 0.497).epsilon(1e-8));
  std::size_t state = 0;
  for (std::size_t i = 0; i < motion.channels.size(); ++i) {
    if (motion.channels[i].name.find("abstract node 2") == 0) state = i;
  }
  REQUIRE(state > 0);
  CHECK(motion.data(motion.data.rows() - 1, static_cast<Eigen::Index>(state)) ==
        Approx(0.25 + 1.5 * 0.497).epsilon(1e-9));

  const std::vector<LinearisedModel> models = linearise_at_times(deck, {});
  REQUIRE(models.size() == 2);
  CHECK(models[1].time == Approx(0.8));  // the first step that reaches it
  CHECK(models[1].y(12) == Approx(0.25 + 1.5 * 0.297).epsilon(1e-8));
  CHECK(models[1].nodes[0].v(0) == Approx(1.5 * 0.297).epsilon(1e-8));
}

namespace {

constexpr double kInertia = 0.05, kTurning = 2.0 * 3.14159265358979323846;  // [kg m^2], of the load [rad/s]
constexpr double kFriction = 0.75;                                          // [N m]

/// A hinge with Coulomb friction under the couple A sin(w t): speed [rad/s] at times, piece by piece in closed form.
/// From t1 on it slides with J omega = A/w (cos(w t1) - cos(w t)) - d M (t - t1), until that is zero.
std::vector<double> sliding_speeds(double A, const std::vector<double>& times, int* stops) {
  std::vector<double> out(times.size(), 0.0);
  *stops = 0;
  const double period = 2.0 * std::acos(-1.0) / kTurning, release = std::asin(kFriction / A) / kTurning;
  double t1 = release;
  while (t1 < times.back()) {
    const double d = std::sin(kTurning * t1) > 0.0 ? 1.0 : -1.0;
    const auto momentum = [&](double t) {
      return d * A / kTurning * (std::cos(kTurning * t1) - std::cos(kTurning * t)) - kFriction * (t - t1);
    };
    double low = t1 + 1e-3, high = low;
    while (momentum(high) > 0.0) high += 1e-3;
    low = high - 1e-3;
    for (int i = 0; i < 60; ++i) (momentum(0.5 * (low + high)) > 0.0 ? low : high) = 0.5 * (low + high);
    const double t2 = high;
    for (std::size_t k = 0; k < times.size(); ++k) {
      if (times[k] > t1 && times[k] < t2) out[k] = d * momentum(times[k]) / kInertia;
    }
    t1 = t2;
    if (std::abs(A * std::sin(kTurning * t2)) > kFriction) continue;  // turns back at once
    ++*stops;
    const double half = 0.5 * period;  // the load reaches the friction in every half period
    t1 = std::floor(t2 / half) * half + release;
    if (t1 < t2) t1 += half;
  }
  return out;
}

}  // namespace

TEST_CASE("a hinge with Coulomb friction sticks, comes free and turns back as its load says") {
  for (const double A : {0.9, 1.1, 1.4, 3.0}) {
    INFO("amplitude of the load " << A << " N m");
    deck_test::DeckText text;
    text.initial = "initial time: 0.; final time: 4.; time step: 0.002; method: ms, 0.6; tolerance: 1.e-9;\n";
    text.globals = "scalar function: \"mu\", const, 0.15;\n";
    text.nodes = "structural: 100, static, null, eye, null, null;\nstructural: 1, dynamic, null, eye, null, null;\n";
    text.elements =
        "joint: 100, clamp, 100, node, node;\nbody: 1, 1, 1., null, diag, 0.05, 0.05, 0.05;\n"
        "joint: 1, revolute hinge, 100, position, null, 1, position, null, friction, 0.05, preload, 100., "
        "discrete coulomb, \"mu\", simple;\ncouple: 1, absolute, 1, 0., 0., 1., sine, 0., 2*pi, " +
        std::to_string(A) + ", forever, 0.;\n";
    const Deck deck = deck_test::read_good(text);
    for (const bool by_ida : {true, false}) {
      INFO((by_ida ? "ida" : "ms"));
      IntegrateOptions options;
      options.integrator = by_ida ? "ida" : "ms";
      const Motion motion = integrate(deck, options);
      const auto speed = static_cast<Eigen::Index>(channel(motion, "node 1.wz"));
      const std::vector<double> times(motion.time.data(), motion.time.data() + motion.time.size());
      int stops = 0;
      const std::vector<double> expected = sliding_speeds(A, times, &stops);
      CHECK((stops > 0) == (A < 1.3));
      double off = 0.0, most = 0.0;
      for (std::size_t k = 0; k < times.size(); ++k) {
        off = std::max(off, std::abs(motion.data(static_cast<Eigen::Index>(k), speed) - expected[k]));
        most = std::max(most, std::abs(expected[k]));
      }
      CHECK(most > 0.1);
      CHECK(off < (by_ida ? 1e-6 : 5e-3) * most);
    }
  }
}
