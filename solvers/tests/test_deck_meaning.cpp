// Decks whose meaning was measured on MBDyn (develop, 2025-06): what the reader makes of them.
//
// SPDX-License-Identifier: BSD-3-Clause
#include "test_deck_support.h"

using deck_test::DeckText;
using mbdae::Vec3;

TEST_CASE("expressions in a deck have MBDyn's values") {
  DeckText deck;
  deck.globals = "set: integer I1 = 5;\n";
  const std::pair<const char*, double> cases[] = {
      {"3^2/4", 2.25},          {"7/2^1", 3.5},         {"abs(-7)/4", 1.75},  {"ceil(2.3)/4", 0.75},
      {"floor(7.5)/4", 1.75},   {"round(6.6)/4", 1.75}, {"max(7,2)/4", 1.75}, {"min(7,9)/4", 1.75},
      {"in_ll(1,2,3)/4", 0.25}, {"round(2.5)", 2.0},    {"step(0)", 0.5},     {"1 || 0 && 0", 0.0},
      {"1 ~| 0 && 0", 0.0},     {"(I1 = 3) + I1", 6.0}, {"-3^2/4", 2.25},     {"9^2/10^2", 0.81}};
  deck.nodes.clear();
  for (std::size_t i = 0; i < std::size(cases); ++i) {
    deck.nodes += "structural: " + std::to_string(i) + ", static, " + cases[i].first + ", 0., 0., eye, null, null;\n";
  }
  const mbdae::Deck read = deck_test::read_good(deck);
  for (std::size_t i = 0; i < std::size(cases); ++i) {
    INFO(cases[i].first);
    CHECK(read.nodes[i].x(0) == cases[i].second);
  }
}

TEST_CASE("whole numbers may come from reals") {
  DeckText deck;
  deck.nodes = "structural: 2^1, static, null, eye, null, null;\n";
  deck.initial += "max iterations: 10.; eigenanalysis: 0., parameter, 0.1;\n";
  CHECK(deck_test::read_good(deck).nodes[0].id.label == 2);
}

TEST_CASE("guess is perpendicular as MBDyn chooses it") {
  const mbdae::Deck deck =
      deck_test::with_nodes("structural: 1, static, null, 3, 0.1, 0.2, 0.9, 1, guess, null, null;\n");
  const Vec3 third = Vec3(0.1, 0.2, 0.9).normalized(), first = Vec3(1.0, 0.0, -0.1 / 0.9).normalized();
  CHECK((deck.nodes[0].R.col(2) - third).norm() < 1e-15);
  CHECK((deck.nodes[0].R.col(0) - first).norm() < 1e-15);
  CHECK((deck.nodes[0].R.col(1) - third.cross(first)).norm() < 1e-15);
}

TEST_CASE("a deck without a method card has ms, 0.") {
  DeckText deck;
  deck.initial = "initial time: 0.; final time: 1.; time step: 0.01;\n";
  const mbdae::Deck read = deck_test::read_good(deck);
  CHECK(read.initial_value.method == mbdae::MethodKind::ms);
  CHECK(read.initial_value.rho == 0.0);
}

TEST_CASE("the upper frequency limit gives the parameter") {
  DeckText deck;
  const auto coefficient = [&](const std::string& options) {
    deck.initial = "initial time: 0.; final time: 1.; time step: 0.01; method: ms, 0.6; eigenanalysis: 0., " + options +
                   ", balance, no, use lapack;\n";
    return 0.5 * deck_test::read_good(deck).initial_value.eigenanalysis->parameter;
  };
  CHECK(coefficient("upper frequency limit, 1000.") == Approx(1.59155e-5).epsilon(1e-6));
  CHECK(coefficient("upper frequency limit, 1.e9") == Approx(0.5e-6));
  CHECK(coefficient("upper frequency limit, 1.e-9") == Approx(0.5e6));
  CHECK(coefficient("upper frequency limit, 1000., parameter, 0.02") == 0.01);
}

TEST_CASE("a viscous law has no prestress") {
  const mbdae::Deck deck =
      deck_test::with_elements("joint: 2, rod, 1, 2, 1., linear viscous, 2., prestress, 5., prestrain, 0.1;\n");
  const auto& law = std::get<mbdae::LinearLaw<1>>(deck.joints[0].as<mbdae::RodData>().law);
  CHECK(law.C(0, 0) == 2.0);
  CHECK(law.prestress(0) == 0.0);
  CHECK(law.prestrain.terms.empty());
}

TEST_CASE("old forms of the first blocks") {
  const std::string text =
      "begin: data; integrator: multistep; end: data;\n"
      "reference: 7, name, \"early\", null, hinge, eye, null, null;\n"
      "begin: multistep; initial time: 0.; final time: 1.; method: ms, .6,; derivatives tolerance: 1e-6, 1e-6;\n"
      " fictitious steps number: 0; fictitious steps ratio: 1e-3; fictitious steps tolerance: 1e-3;\n"
      " fictitious steps max iterations: 10; solver: umfpack; newton raphson: modified, 3; min time step: 1e-6;\n"
      "end: multistep;\n"
      "begin: control data; structural nodes: 1; rigid bodies: 1; forces: 1; inertia: 0; select timeout: forever;\n"
      " make restart file: iterations, 100; end: control data;\n"
      "print symbol table; set: real VAL = 1.; remark: \"value = \" + VAL; remark: \"a\", VAL, \"b\";\n"
      "begin: nodes; structural: 3, name, \"third\", dynamic, null, eye, null, null; end: nodes;\n"
      "begin: elements; body: 3, name, \"b\", 3, 1., null, eye;\n"
      " force: 1, name, \"f\", conservative, 3, position, null, 0., 0., 1., const, 3.; end: elements;\n";
  const mbdae::Deck deck = deck_test::read_good(text);
  CHECK(deck.initial_value.rho == 0.6);
  CHECK(deck.forces[0].as<mbdae::ForceData>().frame == mbdae::ForceFrame::absolute);
}

TEST_CASE("old forms of joints, drives and laws") {
  const char* const forms[] = {
      "joint: 1, spherical hinge, 1, reference, node, null, 2, reference, node, null;\n",
      "joint: 1, deformable hinge, 1, hinge, eye, 2, hinge, eye, linear elastic, 1.;\n",
      "joint: 1, pin, 1, null, null;\n",
      "joint: 1, plane hinge, 1, null, hinge, eye, 2, null, hinge, eye;\n",
      "joint: 1, plane pin, 1, null, hinge, eye, null, hinge, eye;\n",
      "joint: 1, revolute hinge, 1, 0.,0.,0., hinge, eye, 2, -1.,-2.,-3., hinge, eye;\n",
      "joint: 1, rod with offset, 1, position, 1., 0., 0., 2, position, null, 1., linear elastic, 1.;\n",
      "joint: 1, name, \"j\", total joint, 1, 2, position constraint, 1, 1, 1, null;\n",
      "joint: 1, inline, 1, position, null, hinge, eye, 2;\n",
      ("joint: 1, rod, 1, 2, from nodes, muscle, help, model, pennestri, initial length, .3, reference length, .3, "
       "reference velocity, 1.2, reference force, 100., activation, const, .1, activation check, yes;\n"),
      "force: 1, absolute, 1, null, 0., 0., 1., linear, 0., 1.;\n",
      "force: 1, absolute, 1, position, null, zero;\n"};
  for (const char* form : forms) {
    INFO(form);
    DeckText deck;
    deck.elements = form;
    const mbdae::ReadResult result = mbdae::read_deck_text(deck.text(), "test.mbd");
    INFO(deck_test::messages(result));
    CHECK(result.deck.has_value());
  }
  const mbdae::Deck hinge = deck_test::with_elements(forms[5]);
  CHECK(hinge.joints[0].as<mbdae::RevoluteHingeData>().d2 == Vec3(-1.0, -2.0, -3.0));
}

TEST_CASE("old cards with offset want offsets, not the word") {
  const auto rod = [](const std::string& elements) {
    return deck_test::only_joint<mbdae::RodData>(deck_test::with_elements(elements));
  };
  const mbdae::RodData now =
      rod("joint: 1, rod, 1, position, .1, 0., 0., 2, position, 0., .2, 0., 1., linear elastic, 1.;\n");
  const mbdae::RodData old = rod("joint: 1, rod with offset, 1, .1, 0., 0., 2, 0., .2, 0., 1., linear elastic, 1.;\n");
  CHECK(old.f1 == now.f1);
  CHECK(old.f2 == now.f2);
  CHECK(old.L0 == now.L0);
  const auto distance = [](const std::string& elements) {
    return deck_test::only_joint<mbdae::DistanceData>(deck_test::with_elements(elements));
  };
  const mbdae::DistanceData apart = distance("joint: 1, distance with offset, 1, .1, 0., 0., 2, null, from nodes;\n");
  CHECK(apart.f1 == Vec3(0.1, 0.0, 0.0));
  DeckText deck;
  deck.elements = "joint: 1, rod, 1, .1, 0., 0., 2, null, 1., linear elastic, 1.;\n";
  CHECK(deck_test::complaint(deck.text()).find("expected a node label") != std::string::npos);
}

TEST_CASE("abstract nodes may have names") {
  DeckText deck;
  deck.control = "abstract nodes: 1; genels: 1;";
  deck.nodes += "abstract: 7, name, \"u\", differential, value, 2.;\n";
  deck.elements = "genel: 1, spring support, 7, abstract, algebraic, linear viscoelastic, 1., 1.;\n";
  CHECK(deck_test::read_good(deck).abstract_nodes[0].value == 2.0);
}

TEST_CASE("polynomials, broken lines and drive callers in strings") {
  DeckText deck;
  deck.globals = "set: integer RAMP = 5; drive caller: RAMP, piecewise linear, 3, 0., 1., 1., 3., 3., -1.;\n";
  const auto drive = [&](const std::string& text) {
    deck.elements = "force: 1, absolute, 1, position, null, 0., 0., 1., " + text + ";\n";
    return deck_test::read_good(deck).forces[0].as<mbdae::ForceData>().value.terms[0].drive;
  };
  CHECK(drive("linear, 1., 2.")->value(3.0) == 7.0);
  CHECK(drive("parabolic, 1., 2., 3.")->at(2.0).rate == 14.0);
  CHECK(drive("cubic, 1., 2., 3., 4.")->at(2.0).value == 49.0);
  CHECK(drive("cubic, 1., 2., 3., 4.")->at(2.0).second == 54.0);
  const auto line = drive("reference, RAMP");
  const std::pair<double, double> points[] = {{-1.0, 1.0}, {0.0, 1.0},  {0.5, 2.0},
                                              {2.0, 1.0},  {3.0, -1.0}, {9.0, -1.0}};
  for (const auto& [t, value] : points) CHECK(line->value(t) == Approx(value));
  CHECK(line->at(2.0).rate == -2.0);
  const auto string = drive("string, \"model::drive(5, 2.*Time)*Time\"");
  CHECK(string->at(1.0).value == 1.0);
  CHECK(string->at(1.0).rate == Approx(1.0 + 2.0 * -2.0));
}

TEST_CASE("what refers to itself, what is too much, what is not here") {
  const auto said = [](const std::string& globals, const std::string& elements) {
    DeckText deck;
    deck.globals = globals;
    deck.elements = elements;
    return deck_test::complaint(deck.text());
  };
  const auto holds = [](const std::string& text, const std::string& part) {
    INFO(text);
    CHECK(text.find(part) != std::string::npos);
  };
  holds(said("drive caller: 1, const, 5.; drive caller: 2, array, 2, reference, 1, reference, 2;",
             "force: 1, absolute, 1, position, null, 1., 0., 0., reference, 2;\n"),
        "drive caller 2 refers to itself");
  holds(said("reference: 4, reference, 4, null, eye, null, null;", ""), "reference 4 refers to itself");
  holds(said("constitutive law: 4, 1, reference, 4;", ""), "1D constitutive law 4 refers to itself");
  holds(said("drive caller: 4, string, \"model::drive(4, Time)\";", ""), "drive caller 4 refers to itself");

  std::string chain = "drive caller: 1, time;\n", doubled = chain;
  for (int i = 2; i <= 1200; ++i) {
    const std::string before = "reference, " + std::to_string(i - 1);
    chain += "drive caller: " + std::to_string(i) + ", mult, 1., " + before + ";\n";
    if (i < 40) doubled += "drive caller: " + std::to_string(i) + ", array, 2, " + before + ", " + before + ";\n";
  }
  holds(said(chain, ""), "drives that refer to one another over more than 1000 steps");
  holds(said(doubled, ""), "a drive made of more than 100000 others");
  holds(said("drive caller: " + std::string(2000, 'A') + ", const, 1.;", ""), "a word of more than 1000 characters");

  holds(said("", "joint: 1, gear box, 1, 2;\n"), "not supported: the joint type `gear box`");
  holds(said("", "gear train: 1, 2;\n"), "not supported: the card `gear train`");
  holds(said("", "body: 1, 1, 1., null, eye, wobbling, yes;\n"), "not supported: the option `wobbling` of this card");
  holds(said("", "force: 1, absolute, 1, position, null, 1., 0., 0., chirp, 1.;\n"),
        "not supported: the drive `chirp`");
  holds(said("", "joint: 1, cardan hinge, 1, null, 2, null;\n"), "did you mean `cardano hinge`?");
  holds(said("drive caller: 5, const, 1., output, yes, output, no;", ""), "`output` does not belong here");
}
