// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/distance.h"

#include "mbdae/deck/drive_reader.h"
#include "mbdae/elements/ends.h"

namespace mbdae {

struct Distance::Geometry {
  Vec3 f1, f2, D, rate;  // arms, point 2 from point 1 and its rate
  double d;
};

Distance::Distance(const DistanceData& data, const Numbering& numbering)
    : data_(data), node1_(numbering.slot(data.node1)), node2_(numbering.slot(data.node2)), u_(numbering.scalar) {
  first_ = numbering.first;
  size_ = 1;
}

std::vector<ScalarInfo> Distance::scalars() const {
  std::vector<ScalarInfo> out;
  for (int k = 1; k <= 3; ++k) {
    const std::string number = std::to_string(k);
    out.push_back({".direction[" + number + "]", "-", "direction " + number, false});
  }
  return out;
}

Distance::Geometry Distance::geometry(const State& state) const {
  const NodeMotion& n1 = motion_of(state, node1_);
  const NodeMotion& n2 = motion_of(state, node2_);
  Geometry at;
  at.f1 = n1.R * data_.f1;
  at.f2 = n2.R * data_.f2;
  at.D = n2.x + at.f2 - n1.x - at.f1;
  at.rate = n2.v + n2.w.cross(at.f2) - n1.v - n1.w.cross(at.f1);
  at.d = data_.distance->value(state.t);
  return at;
}

void Distance::initialise(State& state) const {
  const Vec3 D = geometry(state).D;
  if (D.norm() > 0.0) state.y.segment<3>(u_) = D.normalized();
}

std::string Distance::defect(const State& state) const {
  const Geometry at = geometry(state);
  if (!(at.d > 0.0)) return "imposes a distance that is not positive";
  if (!(at.D.norm() > 0.0)) return "has points that coincide: its direction is undefined";
  return {};
}

void Distance::assemble(const State& state, Equations& eq, bool tangent, bool reduced) const {
  const Geometry at = geometry(state);
  const Vec3 u = state.y.segment<3>(u_);
  const double f = state.y(first_), length = at.D.norm();
  const Vec3 F = f * u, n = at.D / length;
  add_to_g(eq.g, node1_, -F, -at.f1.cross(F));
  add_to_g(eq.g, node2_, F, at.f2.cross(F));
  if (reduced) {
    eq.g.segment<3>(u_) += u - at.D / at.d;
    eq.g(first_) += length - at.d;
  } else {
    eq.g.segment<3>(u_) += at.D - at.d * u;
    eq.g(first_) += u.norm() - 1.0;
  }
  if (!tangent) return;

  const Mat3 I = Mat3::Identity(), f1x = skew(at.f1), f2x = skew(at.f2);
  // the direction's rows: scale dD, dD = dx2 - f2 x dphi2 - dx1 + f1 x dphi1
  const double scale = reduced ? -1.0 / at.d : 1.0;
  add_block(eq.g_y, u_, node1_.first, -scale * I);
  add_block(eq.g_y, u_, rotation_column(node1_), scale * f1x);
  add_block(eq.g_y, u_, node2_.first, scale * I);
  add_block(eq.g_y, u_, rotation_column(node2_), -scale * f2x);
  eq.g_y.block<3, 3>(u_, u_) += (reduced ? 1.0 : -at.d) * I;
  if (data_.distance->reads_state()) {
    for (int i = 0; i < 3; ++i) {
      const double by_d = reduced ? at.D(i) / (at.d * at.d) : -u(i);
      add_drive_derivative(eq, u_ + i, *data_.distance, state.t, by_d);
    }
    if (reduced) add_drive_derivative(eq, first_, *data_.distance, state.t, -1.0);
  }
  if (reduced) {
    add_row(eq.g_y, first_, node1_.first, -n);
    add_row(eq.g_y, first_, rotation_column(node1_), -at.f1.cross(n));
    add_row(eq.g_y, first_, node2_.first, n);
    add_row(eq.g_y, first_, rotation_column(node2_), at.f2.cross(n));
  } else {
    add_row(eq.g_y, first_, u_, u.normalized());
  }

  const struct {
    const NodeSlot& node;
    const Vec3& arm;
    double s;
  } ends[2] = {{node1_, at.f1, -1.0}, {node2_, at.f2, 1.0}};
  for (const auto& [node, arm, s] : ends) {
    add_column(eq.g_y, node.force, first_, s * u);
    add_column(eq.g_y, moment_row(node), first_, s * arm.cross(u));
    add_block(eq.g_y, node.force, u_, s * f * I);
    add_block(eq.g_y, moment_row(node), u_, s * f * skew(arm));
    add_block(eq.g_y, moment_row(node), rotation_column(node), s * skew_skew(F, arm));
  }
}

void Distance::rates(const State& state, ConstraintRates& out, bool tangent) const {
  const Geometry at = geometry(state);
  const NodeMotion& n1 = motion_of(state, node1_);
  const NodeMotion& n2 = motion_of(state, node2_);
  const Jet d = data_.distance->at(state.t);
  const double length = at.D.norm();
  const Vec3 n = at.D / length, across = at.rate - n.dot(at.rate) * n;
  const Vec3 second = n2.w.cross(n2.w.cross(at.f2)) - n1.w.cross(n1.w.cross(at.f1));
  out.rate(first_) += n.dot(at.rate) - d.rate;
  out.bias(first_) += across.squaredNorm() / length + n.dot(second) - d.second;
  if (!tangent) return;
  // d(n.rate) = across.dD/|D| + n.d(rate)
  const Vec3 by_D = across / length;
  add_row(out.rate_q, first_, node1_.first, -by_D);
  add_row(out.rate_q, first_, node2_.first, by_D);
  add_row(out.rate_q, first_, rotation_column(node1_), -at.f1.cross(by_D) - at.f1.cross(n.cross(n1.w)));
  add_row(out.rate_q, first_, rotation_column(node2_), at.f2.cross(by_D) + at.f2.cross(n.cross(n2.w)));
}

namespace reading {

namespace {

DistanceData read_distance_between(Context& context, Presence offsets) {
  Input& input = context.input;
  End first = read_end(context);
  read_offset(context, first.place(), offsets, &first.position);
  End second = read_end(context);
  read_offset(context, second.after(first), offsets, &second.position);
  DistanceData joint;
  joint.node1 = first.node;
  joint.node2 = second.node;
  joint.f1 = first.position;
  joint.f2 = second.position;
  input.need("the distance as a drive, or `from nodes`");
  const SourcePosition where = input.where();
  if (input.take("from nodes")) {
    const Vec3 D = second.frame.x + second.frame.R * second.position - first.frame.x - first.frame.R * first.position;
    if (!(D.norm() > 0.0)) input.fail(where, "the points coincide: there is no distance to take from the nodes");
    joint.distance = std::make_shared<const ConstDrive>(D.norm());
  } else {
    const AllowStateDrives allow(context);
    joint.distance = read_drive(context);
  }
  return joint;
}

}  // namespace

DistanceData read_distance(Context& context) { return read_distance_between(context, Presence::optional); }

DistanceData read_distance_with_offset(Context& context) { return read_distance_between(context, Presence::required); }

}  // namespace reading

}  // namespace mbdae
