// Modal joint: a linear elastic body in a floating frame, clamped to structural nodes at its interfaces.
//
//   f_i = p_i + T_i a,  th_i = Q_i a               displaced point and small rotation of finite element node i, body
//   axes r = (x, R, v, w) of the modal node             or at rest: a clamped body S = R (S0 + I3 a),  J = R (J0 + sum
//   a_j (I8_j + I8_j^T) - sum a_j a_k I9_jk) R^T,  A = vdot - a_g P = sum b_j I8_j - sum a_j b_k I9_jk,  H = I4 +
//   I5(a),  I5(a)_k = sum a_j I5_jk,  L = sum b_j (I10_j + I10_j^T)
//
//   g[v] += m A - S x wdot + w x (w x S) + R I3 bdot + 2 w x R I3 b
//   g[w] += S x A + J wdot + w x J w + R H bdot + 2 R P R^T w + R (L R^T w + w x R I11 b)
//   g[a]  = adot - b
//   g[b]  = M bdot + C b + K a + (R I3)^T A + (R H)^T wdot + 2 (R I5(b))^T w
//           - w . R (I8_j^T - sum a_k I9_jk + I10_j) R^T w
//
// and for every interface, d1 = R (p + T a), d2 = R2 o, reactions F (on the structural node, global axes) and N (its
// axes):
//
//   g[F] = x + d1 - x2 - d2                        g[N] = axial(R2^T R (1 + (Q a) x))
//   g[v] += F, g[w] += d1 x F + R2 N, g[b] += (R T)^T F + (R Q)^T R2 N, g[F2] -= F, g[M2] -= d2 x F + R2 N
//
// axial(A) is the vector of the skew part of A, sin(angle) n of a rotation; it is zero at R2 = R exp(n atan |Q a|), n
// along Q a. MBDyn's residual has the angle itself, with the same derivative where it is zero. Unknowns: a, b, then F,
// N of every interface. The last term of g[w] has R once too often; it is what MBDyn's matrices and motion contain. It
// vanishes at rest and without moments of inertia of the finite element nodes. Valid for small deformations a in any
// motion of the frame. Source: Shabana, Dynamics of Multibody Systems, chapter 5, for the floating frame;
// docs/io_formats/fem.md for the sums. Tangent: exact in every state; tests test_model_modal.cpp and
// tests/consistency/test_mbdyn_modal.py.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mbdae/elements/modal_data.h"
#include "mbdae/model/element.h"

namespace mbdae {

class ModalJoint final : public Constraint, public Flexible {
 public:
  ModalJoint(const ModalData& data, const Numbering& numbering);

  // ---- the constraints at the interfaces
  void assemble(const State& state, Equations& eq, bool tangent) const override;
  void rates(const State& state, ConstraintRates& out, bool tangent) const override;
  bool is_couple(int k) const override { return k % 6 >= 3; }
  std::string defect(const State& state) const override;
  const Flexible* flexible() const override { return this; }

  // ---- the body
  int modes() const override { return m_; }
  int first_displacement() const override { return own_; }
  const NodeSlot& carrier() const override { return node_; }
  int mode_number(int k) const override { return data_.numbers[static_cast<std::size_t>(k)]; }
  void initialise_modes(Eigen::Ref<Eigen::VectorXd> y) const override;
  void assemble_loads(const State& state, const Vec3& gravity, Equations& eq, bool tangent) const override;
  Eigen::MatrixXd mass_matrix(const State& state) const override;
  Eigen::VectorXd velocity_terms(const State& state) const override;
  InertiaTangent inertia_tangent(const State& state, const Eigen::VectorXd& acceleration) const override;

 private:
  struct Body;
  struct Turn;
  Body body(const State& state) const;
  Turn turn(const State& state, std::size_t i) const;
  auto displacements(const State& state) const { return state.y.segment(own_, m_); }
  auto velocities(const State& state) const { return state.y.segment(own_ + m_, m_); }
  const Mat3& axes(const State& state) const { return node_.index < 0 ? data_.R : motion_of(state, node_).R; }
  const Vec3& origin(const State& state) const { return node_.index < 0 ? data_.x : motion_of(state, node_).x; }

  ModalData data_;
  int m_ = 0;
  int own_ = 0;  ///< first modal displacement; the velocities follow
  NodeSlot node_;
  std::vector<NodeSlot> ends_;
};

/// Forces on modal equations: g[b_k] -= drive.
class ModalForce final : public Element {
 public:
  ModalForce(const ModalForceData& data, const Numbering& numbering);
  void assemble(const State& state, Equations& eq, bool tangent) const override;

 private:
  ModalForceData data_;
  int first_ = 0;  ///< first modal equation (of the velocities)
};

}  // namespace mbdae
