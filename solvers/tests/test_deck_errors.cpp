// Mistakes and exactly what is said about them.
//
// SPDX-License-Identifier: BSD-3-Clause
#include "test_deck_support.h"

using deck_test::complaint;
using deck_test::DeckText;

namespace {

void check_elements(const std::string& cards, const std::string& expected) {
  INFO(cards);
  DeckText deck;
  deck.elements = cards + "\n";
  CHECK(complaint(deck.text()) == expected);
}

void check_globals(const std::string& cards, const std::string& expected) {
  INFO(cards);
  DeckText deck;
  deck.globals = cards;
  CHECK(complaint(deck.text()) == expected);
}

void check_nodes(const std::string& cards, const std::string& expected) {
  INFO(cards);
  DeckText deck;
  deck.nodes = cards + "\n";
  CHECK(complaint(deck.text()) == expected);
}

void check_initial(const std::string& cards, const std::string& expected) {
  INFO(cards);
  DeckText deck;
  deck.initial = cards + "\n";
  CHECK(complaint(deck.text()) == expected);
}

void check_control(const std::string& cards, const std::string& expected) {
  INFO(cards);
  DeckText deck;
  deck.control = cards;
  CHECK(complaint(deck.text()) == expected);
}

}  // namespace

TEST_CASE("mistakes in elements") {
  DeckText joint;
  joint.elements = "joint: 1, revolut hinge, 1, position, null, 2, position, null;";
  const std::string unknown = complaint(joint.text());
  CHECK(unknown.starts_with("test.mbd:14:11: error: unknown joint type `revolut hinge`, expected: clamp, spherical "));
  CHECK(unknown.find(", rod, rod with offset, deformable hinge, ") != std::string::npos);
  CHECK(unknown.ends_with("; did you mean `revolute hinge`?\n"));
  check_elements("joint: 1, brake, 1;", "test.mbd:14:11: error: not supported: the joint `brake`\n");
  check_elements("joint: 1, spherical hinge, 1, 3;", "test.mbd:14:31: error: node 3 is not defined before this card\n");
  check_elements("joint: 1, spherical hinge, 1, 2", "test.mbd:15:1: error: found `end`, expected `,` or `;`\n");
  check_elements("joint: 1, spherical hinge, 1, 2;\njoint: 1, spherical hinge, 1, 2;",
                 "test.mbd:15:8: error: joint 1 is defined already (line 14)\n");
  check_elements("joint: 1, spherical hinge, 1, 1;",
                 "test.mbd:14:11: error: both ends of the joint are on the same node\n");
  check_elements("joint: 1, revolute hinge, 1, 2;",
                 "test.mbd:14:31: error: the card ends here, expected a component of the position\n");
  check_elements("joint: 1, revolute hinge, 1, position, null, orientation, null, 2, position, null;",
                 "test.mbd:14:59: error: `null` is not an orientation, expected `eye`\n");
  check_elements(
      "joint: 1, revolute hinge, 1, position, null, orientation, 3, 0., 1., 0., 1, 0., 2., 0., 2, position, null;",
      "test.mbd:14:77: error: the two vectors are parallel, they define no orientation\n");
  check_elements(
      "joint: 1, revolute hinge, 1, position, null, orientation, 4, 0., 0., 0., 1, 0., 2., 0., 2, position, null;",
      "test.mbd:14:59: error: found axis 4, expected 1, 2 or 3\n");
  check_elements("joint: 1, revolute hinge, 1, position, reference, 9, null, 2, position, null;",
                 "test.mbd:14:51: error: reference 9 is not defined\n");
  check_elements("joint: 1, revolute hinge, 1, position, reference, other node, null, 2, position, null;",
                 "test.mbd:14:51: error: there is no other node here: the frames `other ...` are for the second node "
                 "of a joint\n");
  check_elements("joint: 1, revolute hinge, 1, position, reference, glbal, null, 2, position, null;",
                 "test.mbd:14:51: error: unknown frame `glbal`, expected: global, node, local, other position, other "
                 "orientation, other node or the label of a reference; did you mean `global`?\n");
  check_elements(
      "joint: 1, rod, 1, 2, 0., linear elastic, 1.;",
      "test.mbd:14:22: error: found 0, expected the length of the rod [m], or `from nodes` greater than zero\n");
  check_elements("joint: 1, rod, 1, 2, from nodes, shock absorber, 1.;",
                 "test.mbd:14:34: error: not supported: the constitutive law `shock absorber`\n");
  check_elements("joint: 1, rod, 1, position, 1., 2., 3., 2, from nodes, linear elastic, 1.;",
                 "test.mbd:14:44: error: the ends of the rod coincide, a rod needs a direction\n");
  check_elements("joint: 1, rod, 1, 2, from nodes, linear elastic, 1., prestrain, 1., prestress, 2.;",
                 "test.mbd:14:69: error: `prestress` comes before `prestrain`, and once\n");
  check_elements("joint: 1, deformable hinge, 1, 2, muscle, reference length, 1.;",
                 "test.mbd:14:35: error: the muscle law is for rods (1D), not for this element\n");
  check_elements("joint: 1, rod, 1, 2, from nodes, linear viscoelastic, 1., proportionl, 2.;",
                 "test.mbd:14:59: error: found `proportionl`, expected `proportional`; did you mean `proportional`?\n");
  check_elements("body: 1, 1, -1., null, eye;", "test.mbd:14:13: error: found a mass of -1 kg, expected 0 or more\n");
  check_elements("body: 1, 1, 1., null, diag, 1., 1., -1.;",
                 "test.mbd:14:23: error: the inertia matrix has a negative principal moment, -1 kg m^2\n");
  check_elements("body: 1, 1, 1., null, sym, 0.05, 0.001, 0.002, 0.06, 0.003, 1e308;",
                 "test.mbd:14:23: error: the inertia matrix is too large to have principal moments\n");
  check_elements("body: 1, 1, 1., null, matr, 1., 2., 3., 0., 1., 0., 0., 0., 1.;",
                 "test.mbd:14:23: error: the inertia matrix is not symmetric\n");
  check_elements("body: 1, 1, 1., 0., 0., 0.;",
                 "test.mbd:14:27: error: the card ends here, expected the inertia matrix\n");
  check_elements("body: 1, 1, 1., 0., 0., 0., eye, outpt, yes;",
                 "test.mbd:14:34: error: found `outpt`, expected `;`; did you mean `output`?\n");
  check_elements(
      "couple: 1, absolute, 1, 1., 0., 0., cosin, 0., 1.;",
      "test.mbd:14:37: error: unknown drive `cosin`, expected: const, null, unit, one, time, timestep, direct, ramp, "
      "sine, cosine, step, string, array, mult, reference, linear, node, element, dof, parabolic, cubic, piecewise "
      "linear, file, or a number; did you mean "
      "`cosine`?\n");
  check_elements("couple: 1, absolute, 1, 1., 0., 0., periodic, 2, 0., 1., 0., 1.;",
                 "test.mbd:14:37: error: not supported: the drive `periodic`\n");
  check_elements("couple: 1, absolute, 1, 1., 0., 0., cosine, 0., 1., 1., 0, 0.;",
                 "test.mbd:14:57: error: found 0 cycles, expected 1 or more, -1 or less (to stop at the top), half, "
                 "one, or forever\n");
  check_elements("couple: 1, absolute, 1, 1., 0., 0., string, \"sin(Time\";",
                 "test.mbd:14:45: error: in the string, at character 9: found the end of the "
                 "string, expected `)`\n");
  check_elements("couple: 1, absolute, 1, 1., 0., 0., string, \"1./Time\";",
                 "test.mbd:14:45: error: in the string, at character 3: division by zero (at time 0 s)\n");
  check_elements("couple: 1, absolute, 1, 1., 0., 0., array, 1000000000, 1., 2.;",
                 "test.mbd:14:62: error: the card ends here, expected drive 3 of 1000000000\n");
  check_elements("couple: 1, absolute, 1, reference, global, 1., 0., 0., 1.;",
                 "test.mbd:14:25: error: a frame needs the word `single` before it: `single, reference, ...`\n");
  check_elements("beam3: 1;", "test.mbd:14:1: error: not supported: the element `beam3`\n");
  check_elements("joints: 1, clamp, 1, node, node;",
                 "test.mbd:14:1: error: unknown card `joints`, expected body, joint, genel, gravity, force, couple, "
                 "driven or `end: "
                 "elements;`; did you mean `joint`?\n");
}

TEST_CASE("mistakes in declarations and named things") {
  check_globals("set: real A = B + 1.;", "test.mbd:8:15: error: unknown name `B`\n");
  check_globals(
      "set: reel A = 1.;",
      "test.mbd:8:6: error: found `reel`, expected a type: bool, integer, real, string; did you mean `real`?\n");
  check_globals("include: \"nowhere.mbd\";", "test.mbd:8:10: error: cannot include `nowhere.mbd`: no such file\n");
  check_globals("drive caller: 1, reference, 2;", "test.mbd:8:29: error: drive caller 2 is not defined\n");
  check_globals("refrence: 1, null, eye, null, null;",
                "test.mbd:8:1: error: unknown card `refrence`, expected `begin: nodes;`; did you mean `reference`?\n");
  check_globals("set: real A = ;", "test.mbd:8:15: error: found `;`, expected a number or an expression\n");
  check_globals(
      "remark: \"never closed;",
      "test.mbd:8:9: error: found a string that is never closed by `\"`, expected a number or an expression\n");
  check_globals("set: real A = 1.@;", "test.mbd:8:17: error: found `@`, expected `;`\n");
}

TEST_CASE("mistakes in nodes") {
  check_nodes("structural: 1, dynamic, 0., 0., 0., eye, null;",
              "test.mbd:10:46: error: the card ends here, expected an angular velocity\n");
  check_nodes("structural: 1, dynmic, 0., 0., 0., eye, null, null;",
              "test.mbd:10:16: error: unknown node type `dynmic`, expected: dynamic, static, dummy, modal; did you "
              "mean `dynamic`?\n");
  check_nodes("structural: 1, displacement, 0., 0., 0., eye, null, null;",
              "test.mbd:10:16: error: not supported: the node type `displacement`\n");
  check_nodes("structural: -1, dynamic, 0., 0., 0., eye, null, null;",
              "test.mbd:10:13: error: found -1, expected a node label from 0 on\n");
  check_nodes("structural: 1.5, dynamic, 0., 0., 0., eye, null, null;",
              "test.mbd:10:13: error: found 1.5, expected a node label (an integer)\n");
  check_nodes("structural: 1, dynamic, null, matr, 1., 0., 0., 0., 2., 0., 0., 0., 1., null, null;",
              "test.mbd:10:31: error: the matrix is not a rotation: |R^T R - I| = 3\n");
  check_nodes("structural: 1, dynamic, null, matr, 1e300, 0., 0., 0., 2., 0., 0., 0., 1., null, null;",
              "test.mbd:10:31: error: the matrix is not a rotation: its entries are too large\n");
  check_nodes("structural: 1, dynamic, null, matr, 1., 0., 0., 0., 1., 0., 0., 0., -1., null, null;",
              "test.mbd:10:31: error: the matrix is a reflection (determinant -1), expected a rotation\n");
  check_nodes("structural: 1, dynamic, null eye, null, null;",
              "test.mbd:10:25: error: not supported: `null eye` here, expected a component of the position\n");
  check_nodes("structural: 1, dynamic, null, eye, null, null, ;",
              "test.mbd:10:48: error: found `;` after a comma, expected another argument\n");
}

TEST_CASE("mistakes in the initial value block") {
  check_initial("initial time: 0.; time step: 0.01; method: ms, 0.6;",
                "test.mbd:2:8: error: the initial value block lacks the card `final time: ...;`\n");
  check_initial("initial time: 0.; final time: 1.; time step: 0.; method: ms, 2.;",
                "test.mbd:3:46: error: found 0, expected the time step [s] greater than zero\n"
                "test.mbd:3:62: error: found 2, expected a spectral radius between 0 and 1\n");
  check_initial("initial time: 0.; final time: 1.; time step: 0.1; method: mss, 2.; time stp: 1.;",
                "test.mbd:3:59: error: unknown method `mss`, expected: ms, implicit euler, crank nicolson, bdf, hope, "
                "ss2, ss3, ss4, ms2, ms3, ms4, ms5, bathe, msstc3, msstc4, msstc5, mssth3, mssth4, mssth5, dirk33, "
                "dirk43, dirk54, hybrid, third order, thirdorder, nostro; did you mean `ms`?\n"
                "test.mbd:3:68: error: unknown card `time stp` in the initial value block, expected: initial time, "
                "final time, time step, method, tolerance, max iterations, derivatives tolerance, derivatives max "
                "iterations, derivatives coefficient, eigenanalysis, dummy steps number, dummy steps ratio, dummy "
                "steps tolerance, dummy steps max iterations, dummy steps method, linear solver, nonlinear solver, "
                "output, abort after, threads, min time step, max time step, preconditioner, iterative solver, "
                "strategy, enforce constraint equations; did you mean "
                "`time step`?\n");
  check_initial("initial time: 0.; final time: 1.; time step: 0.1; method: bdf; method: ms, 0.6;",
                "test.mbd:3:64: error: the method is given already (`bdf`), expected one card `method`\n");
  check_initial("initial time: 0.; final time: 1.; time step: 0.1; method: ms, 0.6; eigenanalysis: list, 2, 1., 0.;",
                "test.mbd:3:96: error: found time 0 after 1, expected increasing times\n");
}

TEST_CASE("what MBDyn refuses is refused") {
  check_elements("body: 1, 1, 1., null, eye;;",
                 "test.mbd:14:27: error: found `;` without a card before it, expected a card\n");
  check_elements("force: 1, absolute, 1, position, null, array, 2, single, 0., 0., 1., 3., single, 0., 1., 0., 1.;",
                 "test.mbd:14:50: error: found `single` in an array of vector drives, expected a vector and a drive "
                 "without keyword\n");
  check_nodes("structural: 1, static, null, eye, null, null, accelerations, yes, output, no;",
              "test.mbd:10:67: error: the node option `output` comes too late, expected the order: assembly, scale, "
              "output, accelerations, each at most once\n");
}

TEST_CASE("mistakes in control data") {
  check_control("rigid body kinematics: const, acceleration, null;",
                "test.mbd:6:1: error: not supported: the card `rigid body kinematics`\n");
  check_control("beams: 3;", "test.mbd:6:1: error: not supported: `beams` (only 0 of them)\n");
  check_control("gravity;", "test.mbd:6:1: error: the control data announce gravity, the deck has none\n");
  check_control("joints: 3;", "test.mbd:6:9: error: the control data announce 3 joints, the deck has 0\n");
}
