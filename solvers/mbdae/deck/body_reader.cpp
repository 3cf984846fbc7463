// Bodies and gravity.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Eigenvalues>

#include <cmath>

#include "mbdae/deck/drive_reader.h"
#include "mbdae/deck/element_reader.h"
#include "mbdae/deck/geometry.h"

namespace mbdae::reading {
namespace {

/// Relative to the largest element: asymmetry and negative moments below this are round-off of the input.
constexpr double kRoundOff = 1e-10;

struct Mass {
  double m = 0.0;
  Vec3 d = Vec3::Zero();
  Mat3 J = Mat3::Zero();
};

void check_inertia(Input& input, const SourcePosition& where, const Mat3& J) {
  const double scale = J.cwiseAbs().maxCoeff();
  if (!((J - J.transpose()).cwiseAbs().maxCoeff() <= kRoundOff * scale)) {
    input.fail(where, "the inertia matrix is not symmetric");
  }
  const Eigen::SelfAdjointEigenSolver<Mat3> solver(0.5 * (J + J.transpose()), Eigen::EigenvaluesOnly);
  const Vec3& moments = solver.eigenvalues();  // ascending
  if (!moments.allFinite()) input.fail(where, "the inertia matrix is too large to have principal moments");
  if (!(moments(0) >= -kRoundOff * scale)) {
    input.fail(where, "the inertia matrix has a negative principal moment, " + number_text(moments(0)) + " kg m^2");
  }
  if (moments(2) > (moments(0) + moments(1)) * (1.0 + 1e-6)) {
    input.diagnostics().warning(where, "no body has these principal moments of inertia: " + number_text(moments(2)) +
                                           " is more than the sum of " + number_text(moments(0)) + " and " +
                                           number_text(moments(1)) + " kg m^2");
  }
}

Mass read_mass(Context& context, const Frame& node) {
  Input& input = context.input;
  Place place;
  place.node = &node;
  Mass mass;
  const SourcePosition mass_where = input.where();
  mass.m = input.real("the mass [kg]");
  if (mass.m < 0.0) input.fail(mass_where, "found a mass of " + number_text(mass.m) + " kg, expected 0 or more");
  mass.d = read_position(context, place);
  input.need("the inertia matrix");
  const SourcePosition where = input.where();
  mass.J = read_matrix(context, place, "an element of the inertia matrix");
  if (input.more() && (input.take("orientation") || input.take("inertial"))) {
    input.need("`node` or an orientation");
    if (!input.take("node")) {
      const Mat3 R = read_orientation(context, place);
      mass.J = R * mass.J * R.transpose();
    }
  }
  check_inertia(input, where, mass.J);
  return mass;
}

/// One body of several lumps rigidly on the same node.
Mass condensed(Context& context, const Frame& node) {
  Input& input = context.input;
  const SourcePosition where = input.where();
  const std::int64_t count = input.integer("the number of masses");
  if (count < 1) input.fail(where, "found " + std::to_string(count) + " masses, expected 1 or more");
  std::vector<Mass> lumps;
  Mass total;
  for (std::int64_t i = 0; i < count; ++i) {
    input.need([&] { return "mass " + std::to_string(i + 1) + " of " + std::to_string(count); });
    lumps.push_back(read_mass(context, node));
    total.m += lumps.back().m;
    total.d += lumps.back().m * lumps.back().d;
  }
  if (!(total.m > 0.0)) input.fail(where, "the condensed body has no mass, so it has no centre of mass");
  total.d /= total.m;
  for (const Mass& lump : lumps) {
    const Mat3 arm = skew(lump.d - total.d);
    total.J += lump.J - lump.m * arm * arm;
  }
  return total;
}

}  // namespace

void read_body(Context& context) {
  Input& input = context.input;
  ++context.body_count.found;
  const Label label = input.label("a body label");
  context.bodies.announce(input, label);
  skip_name(input);
  BodyData body;
  body.id = identity(label, "body");
  const SourcePosition where = input.where();
  body.node = context.node();
  const NodeData& node = context.deck.nodes[body.node];
  if (node.kind == NodeKind::static_node && !context.deck.control.static_model) {
    input.fail(where, quoted(node.id.name) +
                          " is a static node, a body needs a dynamic one (or `model: static;` in the control data)");
  }
  const Frame frame = context.frame(body.node);
  input.need("a mass");
  const Mass mass = input.take("condense") ? condensed(context, frame) : read_mass(context, frame);
  if (mass.m == 0.0) input.diagnostics().warning(label.where, "the body has no mass");
  body.m = mass.m;
  body.d = mass.d;
  body.J_cm = mass.J;
  if (input.more() && input.take("inverse dynamics")) {
    for (const char* flag : {"torque", "prescribed motion", "right hand side", "ergonomy"}) {
      if (input.more() && input.take(flag)) input.yes_no();
    }
  }
  if (input.more()) skip_output(input);
  input.end_card();
  context.deck.bodies.push_back(std::move(body));
  context.bodies.define(label, {});
}

void read_gravity(Context& context) {
  Input& input = context.input;
  if (++context.gravity_count.found > 1) input.fail(input.card_position(), "gravity is defined already");
  input.need("a gravity field");
  if (const auto words = input.peek_words(); words && words->is("central")) {
    input.fail(words->where, "not supported: the gravity field `central`");
  }
  input.take("uniform");
  const Place global;
  VectorDrive<3> field = read_vector_drive(context, &global);
  if (input.more()) skip_output(input);
  input.end_card();
  context.deck.gravity = std::move(field);
}

}  // namespace mbdae::reading
