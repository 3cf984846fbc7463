// Every card of the language against the data it should give.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <limits>

#include "test_deck_support.h"

using deck_test::DeckText;
using deck_test::only_joint;
using deck_test::read_good;
using deck_test::with_elements;
using deck_test::with_nodes;
using mbdae::Mat3;
using mbdae::Vec3;

namespace {

template <class Law>
Law law_of_rod(const std::string& law, const std::string& globals = "") {
  DeckText deck;
  deck.globals = globals;
  deck.elements = "joint: 1, rod, 1, 2, 2., " + law + ";\n";
  return std::get<Law>(only_joint<mbdae::RodData>(read_good(deck)).law);
}

mbdae::Law3 law_of_hinge(const std::string& law, const std::string& globals = "") {
  DeckText deck;
  deck.globals = globals;
  deck.elements = "joint: 1, deformable hinge, 1, 2, " + law + ";\n";
  return only_joint<mbdae::DeformableHingeData>(read_good(deck)).law;
}

mbdae::InitialValueData initial_value(const std::string& cards) {
  DeckText deck;
  deck.initial = "initial time: 0.; final time: 1.; time step: 0.01; " + cards;
  return read_good(deck).initial_value;
}

}  // namespace

TEST_CASE("initial value cards") {
  const mbdae::InitialValueData data = initial_value(
      "initial time: 0.5; final time: forever; time step: 1e-3; method: ms, 0.4, 0.2; tolerance: 1e-8, test, norm, "
      "scale;"
      "max iterations: 30, at most; derivatives tolerance: 1e-4; derivatives max iterations: 40; derivatives "
      "coefficient: 0.5, auto, max iterations, 3, factor, 10.;"
      "dummy steps number: 0; linear solver: umfpack; nonlinear solver: newton raphson, modified, 5; output: "
      "iterations, residual; threads: disable;"
      "eigenanalysis: list, 2, 0.5, 1., suffix width, compute, suffix format, \"%02d\", output full matrices, output "
      "eigenvectors, output geometry,"
      "  matrix output precision, 17, results output precision, 17, parameter, 0.02, mode, smallest magnitude, lower "
      "frequency limit, 0.1,"
      "  upper frequency limit, 50., use lapack, balance, no;\n");
  CHECK(data.initial_time == 0.5);
  CHECK(data.final_time == std::numeric_limits<double>::infinity());
  CHECK(data.time_step == 1e-3);
  CHECK(data.method == mbdae::MethodKind::ms);
  CHECK(data.rho == 0.4);
  CHECK(data.rho_algebraic == 0.2);
  CHECK(data.tolerance == 1e-8);
  CHECK(data.max_iterations == 30);
  CHECK(data.derivatives_tolerance == 1e-4);
  CHECK(data.derivatives_max_iterations == 40);
  CHECK(data.derivatives_coefficient == 0.5);
  REQUIRE(data.eigenanalysis.has_value());
  CHECK(data.eigenanalysis->times == std::vector<double>{0.5, 1.0});
  CHECK(data.eigenanalysis->parameter == 0.02);
  CHECK(data.eigenanalysis->where.line == 3);
}

TEST_CASE("methods") {
  CHECK(initial_value("method: ms, 0.3;\n").rho_algebraic == 0.3);
  CHECK(initial_value("method: implicit euler;\n").method == mbdae::MethodKind::implicit_euler);
  CHECK(initial_value("method: crank nicolson;\n").method == mbdae::MethodKind::crank_nicolson);
  CHECK(initial_value("method: hope, 0.6, 0.6;\n").method == mbdae::MethodKind::other);
  CHECK(initial_value("method: hope, 0.6, 0.6;\n").method_text == "hope");
  CHECK(initial_value("method: ms, 0.6; eigenanalysis: -1., use arpack, 10, 20, 0., max iterations, 30;\n")
            .eigenanalysis->parameter == 1.0);
}

TEST_CASE("control data") {
  DeckText deck;
  deck.control =
      "print: dof stats, dof description, equation description, to file; default output: none, structural nodes; "
      "default orientation: euler321;"
      "output precision: 16; output frequency: 10; output results: netcdf, nc4, no sync, no text; initial stiffness: "
      "1., 2.; tolerance: 1e-6;"
      "max iterations: 10; use: gravity, rigid bodies, in assembly; omega rotates: no; loadable elements: 0;";
  CHECK_FALSE(read_good(deck).control.static_model);
  deck.control = "model: static; skip initial joint assembly;";
  CHECK(read_good(deck).control.static_model);
  CHECK(read_good(deck).control.skip_initial_joint_assembly);
}

TEST_CASE("names come from constants, labels live in their own spaces") {
  DeckText deck;
  deck.globals = "set: const integer HAND_L = 3; set: integer Wrist = 7;";
  deck.nodes =
      "structural: HAND_L, dynamic, null, eye, null, null; structural: 1 + HAND_L, dynamic, null, eye, null, null;\n";
  deck.elements =
      "body: HAND_L, HAND_L, 1., null, eye; body: 5, 4, 1., null, eye; joint: Wrist, spherical hinge, HAND_L, 4; "
      "joint: 8, spherical hinge, 4, 3;"
      "force: 8, absolute, 3, position, null, 0., 0., 1., 1.; couple: 9, follower, 3, position, null, 0., 0., 1., "
      "1.;\n";
  const mbdae::Deck read = read_good(deck);
  CHECK(read.nodes[0].id.name == "hand_l");
  CHECK(read.nodes[0].id.label == 3);
  CHECK(read.nodes[0].id.where.line == 10);
  CHECK(read.nodes[0].id.where.column == 13);
  CHECK(read.nodes[1].id.name == "node 4");
  CHECK(read.bodies[0].id.name == "hand_l");
  CHECK(read.bodies[1].id.name == "body 5");
  CHECK(read.joints[0].id.name == "wrist");
  CHECK(read.joints[1].id.name == "joint 8");
  CHECK(read.forces[0].id.name == "force 8");
  CHECK(read.forces[1].id.name == "couple 9");
  CHECK(read.forces[1].as<mbdae::ForceData>().couple);
  CHECK(read.forces[1].as<mbdae::ForceData>().frame == mbdae::ForceFrame::follower);
}

TEST_CASE("nodes with their options, dummy nodes") {
  const mbdae::Deck deck = with_nodes(
      "structural: 1, dynamic, position, 1., 2., 3., orientation, eye, orientation description, euler123, velocity, "
      "4., 5., 6.,"
      " angular velocity, 7., 8., 9., assembly, 1., 2., yes, scale, default, output, no, accelerations, yes;\n"
      "structural: 2, dummy, 1, offset, 0.1, 0.2, 0.3, euler, 0., 0., 0.5;\n"
      "structural: 3, static, null, eye, null, null, output, no;\n");
  REQUIRE(deck.nodes.size() == 2);
  CHECK(deck.nodes[0].v == Vec3(4, 5, 6));
  CHECK(deck.nodes[0].w == Vec3(7, 8, 9));
  REQUIRE(deck.dummy_nodes.size() == 1);
  CHECK(deck.dummy_nodes[0].base == 0);
  CHECK(deck.dummy_nodes[0].offset == Vec3(0.1, 0.2, 0.3));
  CHECK(deck.dummy_nodes[0].rotation(1, 0) == Approx(std::sin(0.5)).epsilon(1e-14));
}

TEST_CASE("gravity") {
  const mbdae::Deck deck = with_elements("gravity: uniform, 0., -1., 0., const, 9.81;\n");
  REQUIRE(deck.gravity.has_value());
  CHECK(deck.gravity->at(0.0) == Vec3(0, -9.81, 0));
  CHECK(with_elements("gravity: 0., 0., -1., ramp, 9.81, 0., 1., 0.;\n").gravity->at(0.5)(2) ==
        Approx(-4.905).epsilon(1e-14));
}

TEST_CASE("forces have arms in the node") {
  const mbdae::Deck deck = with_elements(
      "force: 1, absolute, 2, position, reference, global, 1., 2., 4., 0., 0., 1., const, 3.;\n"
      "force: 2, follower, 2, position, 0.1, 0., 0., single, 0., 1., 0., time;\n");
  CHECK(deck.forces[0].as<mbdae::ForceData>().arm == Vec3(0, 0, 1));
  CHECK(deck.forces[0].as<mbdae::ForceData>().node == 1);
  CHECK(deck.forces[0].as<mbdae::ForceData>().value.at(0.0) == Vec3(0, 0, 3));
  CHECK(deck.forces[1].as<mbdae::ForceData>().frame == mbdae::ForceFrame::follower);
  CHECK(deck.forces[1].as<mbdae::ForceData>().value.at(2.0) == Vec3(0, 2, 0));
}

TEST_CASE("clamp") {
  const auto at_node = only_joint<mbdae::ClampData>(with_elements("joint: 1, clamp, 2, node, node;\n"));
  CHECK(at_node.node == 1);
  CHECK(at_node.X == Vec3(1, 2, 3));
  CHECK(at_node.R == Mat3::Identity());
  const auto moved =
      only_joint<mbdae::ClampData>(with_elements("joint: 1, clamp, 2, position, 4., 5., 6., orientation, euler, 0., "
                                                 "0., 0.1, output, no, initial state, 1., 2., 3., 4., 5., 6.;\n"));
  CHECK(moved.X == Vec3(4, 5, 6));
  CHECK(moved.R(1, 0) == Approx(std::sin(0.1)).epsilon(1e-14));
  REQUIRE(moved.initial_reaction.has_value());
  CHECK((*moved.initial_reaction)(5) == 6.0);
}

TEST_CASE("spherical and revolute joints") {
  const auto spherical = only_joint<mbdae::SphericalHingeData>(
      with_elements("joint: 1, spherical hinge, 1, position, 1., 0., 0., orientation, eye, 2, position, reference, "
                    "node, 0., 2., 0.;\n"));
  CHECK(spherical.d1 == Vec3(1, 0, 0));
  CHECK(spherical.d2 == Vec3(0, 2, 0));
  CHECK(only_joint<mbdae::SphericalHingeData>(with_elements("joint: 1, spherical hinge, 1, 2;\n")).d1 == Vec3::Zero());
  const auto pin = only_joint<mbdae::SphericalPinData>(
      with_elements("joint: 1, spherical pin, 2, position, 0., 1., 0., position, reference, global, 1., 3., 3.;\n"));
  CHECK(pin.d == Vec3(0, 1, 0));
  CHECK(pin.X0 == Vec3(1, 3, 3));
  const auto hinge = only_joint<mbdae::RevoluteHingeData>(
      with_elements("joint: 1, revolute hinge, 1, position, 1., 0., 0., orientation, euler, 0.1, 0., 0., 2, position, "
                    "null, initial theta, 0.3,"
                    " orientation description, euler123, inverse dynamics, torque, yes, prescribed motion, no, initial "
                    "state, 1., 2., 3., 4., 5.;\n"));
  CHECK(hinge.R1h(2, 1) == Approx(std::sin(0.1)).epsilon(1e-14));
  CHECK(hinge.R2h == Mat3::Identity());
  CHECK(hinge.initial_theta == 0.3);
  REQUIRE(hinge.initial_reaction.has_value());
  CHECK((*hinge.initial_reaction)(4) == 5.0);
  const auto revolute_pin = only_joint<mbdae::RevolutePinData>(
      with_elements("joint: 1, revolute pin, 2, position, null, orientation, euler, 0., 0.1, 0., position, 1., 2., 3., "
                    "orientation, euler, 0., 0., 0.2;\n"));
  CHECK(revolute_pin.Rh(0, 2) == Approx(std::sin(0.1)).epsilon(1e-14));
  CHECK(revolute_pin.R0(1, 0) == Approx(std::sin(0.2)).epsilon(1e-14));
  CHECK(revolute_pin.X0 == Vec3(1, 2, 3));
  CHECK_FALSE(revolute_pin.initial_theta.has_value());
}

TEST_CASE("cardano, in line and total pin joints") {
  for (const char* word : {"cardano", "universal"}) {
    const std::string name = word;
    const auto hinge = only_joint<mbdae::CardanoHingeData>(
        with_elements("joint: 1, " + name +
                      " hinge, 1, position, 1., 0., 0., 2, position, 0., 1., 0., orientation, euler, 0.1, 0., 0.;\n"));
    CHECK(hinge.d2 == Vec3(0, 1, 0));
    CHECK(hinge.R2h(2, 1) == Approx(std::sin(0.1)).epsilon(1e-14));
    const auto pin = only_joint<mbdae::CardanoPinData>(with_elements(
        "joint: 1, " + name +
        " pin, 2, position, null, orientation, eye, position, 1., 2., 3., orientation, euler, 0., 0., 0.2;\n"));
    CHECK(pin.R0(1, 0) == Approx(std::sin(0.2)).epsilon(1e-14));
  }
  const auto line =
      only_joint<mbdae::InLineData>(with_elements("joint: 1, in line, 1, position, 1., 0., 0., orientation, 3, 1., 0., "
                                                  "0., 1, 0., 1., 0., 2, offset, 0., 0.1, 0.;\n"));
  CHECK(line.p == Vec3(1, 0, 0));
  CHECK(line.Rv.col(2) == Vec3(1, 0, 0));
  CHECK(line.q == Vec3(0, 0.1, 0));
  const auto pin = only_joint<mbdae::TotalPinData>(
      with_elements("joint: 1, total pin joint, 2, position, 0.1, 0., 0., rotation orientation, euler, 0.1, 0., 0., "
                    "position, 1., 2., 3.,"
                    " position orientation, euler, 0., 0., 0.2, position constraint, active, velocity, 0, component, "
                    "0., cosine, 0., 1., 0.1, forever, 0., 0.,"
                    " orientation constraint, 1, 1, 1, null;\n"));
  using C = mbdae::TotalComponent;
  CHECK(pin.fn == Vec3(0.1, 0, 0));
  CHECK(pin.Rnhr(2, 1) == Approx(std::sin(0.1)).epsilon(1e-14));
  CHECK(pin.Rnh == Mat3::Identity());
  CHECK(pin.Xc == Vec3(1, 2, 3));
  CHECK(pin.Rch(1, 0) == Approx(std::sin(0.2)).epsilon(1e-14));
  CHECK(pin.Rchr == Mat3::Identity());
  CHECK(pin.position == std::array<C, 3>{C::position, C::velocity, C::inactive});
  CHECK(pin.position_drive.at(1.0)(1) == Approx(0.1 * (1.0 - std::cos(1.0))).epsilon(1e-14));
  CHECK(pin.rotation_drive.terms.empty());
}

TEST_CASE("rods") {
  const auto rod =
      only_joint<mbdae::RodData>(with_elements("joint: 1, rod, 1, position, 1., 2., 0., 2, position, null, from nodes, "
                                               "linear elastic, 5.*model::current(\"L0\");\n"));
  CHECK(rod.L0 == 3.0);
  CHECK(rod.f1 == Vec3(1, 2, 0));
  CHECK(std::get<mbdae::LinearLaw<1>>(rod.law).K(0, 0) == 15.0);
}

TEST_CASE("linear laws") {
  using L1 = mbdae::LinearLaw<1>;
  CHECK(law_of_rod<L1>("linear elastic, 5.").K(0) == 5.0);
  CHECK(law_of_rod<L1>("linear elastic isotropic, 5.").K(0) == 5.0);
  CHECK(law_of_rod<L1>("linear viscous, 5.").C(0) == 5.0);
  CHECK(law_of_rod<L1>("linear viscoelastic generic, 5., proportional, 0.1").C(0) == 0.5);
  const auto full =
      law_of_rod<L1>("linear viscoelastic, 5., 6., prestress, 7., prestrain, single, 2., ramp, 1., 0., forever, 0.");
  CHECK(full.C(0) == 6.0);
  CHECK(full.prestress(0) == 7.0);
  CHECK(full.prestrain.at(0.5)(0) == 1.0);
  const auto isotropic = std::get<mbdae::LinearLaw<3>>(law_of_hinge(
      "linear viscoelastic, 5., proportional, 0.1, prestress, 1., 2., 3., prestrain, single, 0., 0., 1., 0.9"));
  CHECK(isotropic.K == 5.0 * Mat3::Identity());
  CHECK(isotropic.C == 0.5 * Mat3::Identity());
  CHECK(isotropic.prestress == Vec3(1, 2, 3));
  CHECK(isotropic.prestrain.at(0.0) == Vec3(0, 0, 0.9));
  const auto generic = std::get<mbdae::LinearLaw<3>>(law_of_hinge(
      "linear viscoelastic generic, matr, 1., 2., 3., 4., 5., 6., 7., 8., 9., skew, 1., 2., 3., scale, 2."));
  CHECK(generic.K(1, 2) == 6.0);
  CHECK(generic.C(2, 1) == 2.0);
  CHECK(generic.C(1, 2) == -2.0);
  const auto bare =
      std::get<mbdae::LinearLaw<3>>(law_of_hinge("linear viscous generic, 1., 2., 3., 4., 5., 6., 7., 8., 9."));
  CHECK(bare.C(2, 0) == 7.0);
}

TEST_CASE("laws of six components") {
  const auto joint = only_joint<mbdae::DeformableJointData>(with_elements(
      "joint: 1, deformable joint, 1, position, 1., 0., 0., 2, position, null, orientation, euler, 0., 0., 0.1,"
      " linear viscoelastic generic, sym, 1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 11., 12., 13., 14., 15., 16., 17., "
      "18., 19., 20., 21.,"
      " diag, 1., 2., 3., 4., 5., 6., prestress, 1., 2., 3., 4., 5., 6., prestrain, 0., 0., 0., 0., 0., 1., time;\n"));
  const auto law = std::get<mbdae::LinearLaw<6>>(joint.law);
  CHECK(law.K(0, 5) == 6.0);
  CHECK(law.K(5, 0) == 6.0);
  CHECK(law.K(1, 1) == 7.0);
  CHECK(law.K(5, 5) == 21.0);
  CHECK(law.C(5, 5) == 6.0);
  CHECK(law.C(0, 1) == 0.0);
  CHECK(law.prestress(5) == 6.0);
  CHECK(law.prestrain.at(2.0)(5) == 2.0);
}

TEST_CASE("cubic laws") {
  const auto rod = law_of_rod<mbdae::CubicLaw<1>>("cubic elastic generic, 1., 2., 3., prestress, 4.");
  CHECK(rod.K1(0) == 1.0);
  CHECK(rod.K2(0) == 2.0);
  CHECK(rod.K3(0) == 3.0);
  CHECK(rod.C(0) == 0.0);
  CHECK(rod.prestress(0) == 4.0);
  const auto hinge = std::get<mbdae::CubicLaw<3>>(
      law_of_hinge("cubic viscoelastic generic, 1., 2., 3., null, 7., 8., 9., diag, 1., 2., 3."));
  CHECK(hinge.K1 == Vec3(1, 2, 3));
  CHECK(hinge.K2 == Vec3::Zero());
  CHECK(hinge.K3 == Vec3(7, 8, 9));
  CHECK(hinge.C(1, 1) == 2.0);
}

TEST_CASE("named laws") {
  const std::string globals =
      "constitutive law: 4, name, \"four\", 1, linear elastic, 5.; constitutive law: 4, 3, linear elastic, 6.;";
  CHECK(law_of_rod<mbdae::LinearLaw<1>>("reference, 4", globals).K(0) == 5.0);
  CHECK(std::get<mbdae::LinearLaw<3>>(law_of_hinge("reference, 4", globals)).K(2, 2) == 6.0);
}

TEST_CASE("muscles") {
  const std::string module = "module load: \"libmodule-muscles\";";
  const auto small =
      law_of_rod<mbdae::MuscleLaw>("muscle, reference length, 2., reference force, 100., activation, 0.5", module);
  CHECK(small.model == mbdae::MuscleModel::pennestri);
  CHECK(small.Li == 2.0);
  CHECK(small.V0 == 8.0);
  CHECK_FALSE(small.activation_check);
  CHECK_FALSE(small.reflex.has_value());
  CHECK(small.prestrain == nullptr);
  const auto full = law_of_rod<mbdae::MuscleLaw>(
      "muscle, model, pennestri, initial length, 2., reference length, 2.1, reference velocity, 7., reference force, "
      "100., activation, time,"
      " activation check, yes, warn, yes, ergonomy, no, reflexive, proportional gain, 1.2, derivative gain, const, "
      "0.05, reference length, 1.9,"
      " short range stiffness, model, linear, gamma, 200., delta, 1e-3, prestress, 3., prestrain, 0.1",
      module);
  CHECK(full.L0 == 2.1);
  CHECK(full.V0 == 7.0);
  CHECK(full.F0 == 100.0);
  CHECK(full.activation->value(0.25) == 0.25);
  CHECK(full.activation_check);
  REQUIRE(full.reflex.has_value());
  CHECK(full.reflex->proportional_gain->value(0.0) == 1.2);
  CHECK(full.reflex->derivative_gain->value(0.0) == 0.05);
  CHECK(full.reflex->reference_length->value(0.0) == 1.9);
  REQUIRE(full.short_range.has_value());
  CHECK(full.short_range->model == mbdae::ShortRangeModel::linear);
  CHECK(full.short_range->gamma == 200.0);
  CHECK(full.prestress == 3.0);
  CHECK(full.prestrain->value(0.0) == 0.1);
  CHECK(law_of_rod<mbdae::MuscleLaw>(
            "muscle, model, erf, reference length, 2., reference force, 1., activation, 0., ergonomy, yes", module)
            .ergonomy);
}

TEST_CASE("remarks, modules and the rest of the frame") {
  DeckText deck;
  deck.globals = "remark: \"hello\", 3; module load: \"libmodule-other\", 1, \"x\"; set: real A = print(1.);";
  CHECK(read_good(deck).files == std::vector<std::string>{"test.mbd"});
}
