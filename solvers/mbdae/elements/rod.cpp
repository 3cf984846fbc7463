// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/rod.h"

#include "mbdae/deck/law_reader.h"
#include "mbdae/elements/ends.h"

namespace mbdae {

Rod::Rod(const RodData& data, const Numbering& numbering)
    : data_(data), node1_(numbering.slot(data.node1)), node2_(numbering.slot(data.node2)) {}

Rod::Geometry Rod::geometry(const State& state) const {
  const NodeMotion& n1 = motion_of(state, node1_);
  const NodeMotion& n2 = motion_of(state, node2_);
  Geometry geo;
  geo.f1 = n1.R * data_.f1;
  geo.f2 = n2.R * data_.f2;
  geo.u = n2.x + geo.f2 - n1.x - geo.f1;
  geo.udot = n2.v + n2.w.cross(geo.f2) - n1.v - n1.w.cross(geo.f1);
  geo.l = geo.u.norm();
  geo.eps = geo.l / data_.L0 - 1.0;
  geo.eps_rate = geo.u.dot(geo.udot) / (geo.l * data_.L0);
  return geo;
}

std::string Rod::defect(const State& state) const {
  if (!(geometry(state).l < 1e-12 * data_.L0)) return {};
  return "has ends that coincide: its direction is undefined; move one of its points";
}

double Rod::length(const State& state) const { return geometry(state).l; }

MuscleValue Rod::value(const State& state) const {
  const Geometry geo = geometry(state);
  return evaluate(std::get<MuscleLaw>(data_.law), state.t, geo.eps, geo.eps_rate);
}

void Rod::add_activation_derivative(const State& state, const MuscleValue& value,
                                    Eigen::Ref<Eigen::VectorXd> column) const {
  const Geometry geo = geometry(state);
  const Vec3 F = geo.u * (value.by_activation / geo.l);
  add_to_g(column, node1_, -F, -geo.f1.cross(F));
  add_to_g(column, node2_, F, geo.f2.cross(F));
}

void Rod::assemble(const State& state, Equations& eq, bool tangent) const {
  const Geometry geo = geometry(state);
  const auto [f, k, d] = evaluate(data_.law, state.t, geo.eps, geo.eps_rate);
  const Vec3 n = geo.u / geo.l, F = f * n;
  add_to_g(eq.g, node1_, -F, -geo.f1.cross(F));
  add_to_g(eq.g, node2_, F, geo.f2.cross(F));
  if (!tangent) return;

  if (const auto* muscle = std::get_if<MuscleLaw>(&data_.law); muscle != nullptr && muscle->activation->reads_state()) {
    const double by_activation = evaluate(*muscle, state.t, geo.eps, geo.eps_rate).by_activation;
    const NodeSlot* nodes[2] = {&node1_, &node2_};
    const Vec3 pull[2] = {-by_activation * n, by_activation * n},
               moments[2] = {geo.f1.cross(pull[0]), geo.f2.cross(pull[1])};
    for (int i = 0; i < 2; ++i) {
      for (int j = 0; j < 3 && nodes[i]->force >= 0; ++j) {
        add_drive_derivative(eq, nodes[i]->force + j, *muscle->activation, state.t, pull[i](j));
        add_drive_derivative(eq, nodes[i]->force + 3 + j, *muscle->activation, state.t, moments[i](j));
      }
    }
  }

  // dF = D_x du + D_v dudot
  const double L0 = data_.L0;
  const Mat3 D_v = (d / L0) * n * n.transpose();
  Mat3 D_x = n * ((k / L0 - f / geo.l - d * geo.eps_rate / geo.l) * n + (d / (L0 * geo.l)) * geo.udot).transpose();
  D_x.diagonal().array() += f / geo.l;

  // du = dx2 - f2 x dphi2 - ..., dudot = dv2 - f2 x dw2 - w2 x (f2 x dphi2) - ...
  const Vec3& w1 = motion_of(state, node1_).w;
  const Vec3& w2 = motion_of(state, node2_).w;
  const Mat3 f1x = skew(geo.f1), f2x = skew(geo.f2);
  const Mat3 V1 = D_v * f1x, V2 = -D_v * f2x;
  Mat3 G1 = D_x * f1x, G2 = -D_x * f2x;
  if (d != 0.0) {
    if (!w1.isZero(0.0)) G1 += D_v * skew_skew(w1, geo.f1);
    if (!w2.isZero(0.0)) G2 -= D_v * skew_skew(w2, geo.f2);
  }

  // dF = D (dx2 - dx1) + G1 dg1 + G2 dg2 in the force and moment rows of one end
  const auto add_rows = [&](Eigen::MatrixXd& A, int row, double s, const Mat3& arm, const Mat3& D, const Mat3& by_g1,
                            const Mat3& by_g2) {
    add_block(A, row, node1_.first, -s * D);
    add_block(A, row, rotation_column(node1_), s * by_g1);
    add_block(A, row, node2_.first, s * D);
    add_block(A, row, rotation_column(node2_), s * by_g2);
    const Mat3 aD = arm * D;
    add_block(A, row + 3, node1_.first, -aD);
    add_block(A, row + 3, rotation_column(node1_), arm * by_g1);
    add_block(A, row + 3, node2_.first, aD);
    add_block(A, row + 3, rotation_column(node2_), arm * by_g2);
  };
  const NodeSlot* ends[2] = {&node1_, &node2_};
  const Mat3* arms[2] = {&f1x, &f2x};
  const double signs[2] = {-1.0, 1.0};
  for (int i = 0; i < 2; ++i) {
    const NodeSlot& row = *ends[i];
    if (row.force < 0) continue;
    const double s = signs[i];
    const Mat3 arm = s * *arms[i];
    add_rows(eq.g_y, row.force, s, arm, D_x, G1, G2);
    if (d != 0.0) add_rows(eq.g_ydot, row.force, s, arm, D_v, V1, V2);
    // the arm turns with its node
    add_block(eq.g_y, row.force + 3, rotation_column(row), s * skew_skew(F, i == 0 ? geo.f1 : geo.f2));
  }
}

namespace reading {

namespace {

RodData read_rod_between(Context& context, Presence offsets) {
  Input& input = context.input;
  End first = read_end(context);
  read_offset(context, first.place(), offsets, &first.position);
  End second = read_end(context);
  read_offset(context, second.after(first), offsets, &second.position);
  if (first.node == second.node) input.fail(input.card_position(), "a rod needs two different nodes");
  RodData joint;
  joint.node1 = first.node;
  joint.node2 = second.node;
  joint.f1 = first.position;
  joint.f2 = second.position;
  const double distance =
      (second.frame.x + second.frame.R * second.position - first.frame.x - first.frame.R * first.position).norm();
  input.need("the length of the rod or `from nodes`");
  const SourcePosition where = input.where();
  if (!(distance > 0.0)) input.fail(where, "the ends of the rod coincide, a rod needs a direction");
  joint.L0 = input.take("from nodes") ? distance : input.positive("the length of the rod [m], or `from nodes`");
  joint.law = read_law1(context, &joint.L0);
  return joint;
}

}  // namespace

RodData read_rod(Context& context) { return read_rod_between(context, Presence::optional); }

RodData read_rod_with_offset(Context& context) { return read_rod_between(context, Presence::required); }

}  // namespace reading

}  // namespace mbdae
