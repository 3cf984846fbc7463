// Unit quaternions q = (q0, q1, q2, q3) as unknowns of an integration.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/model/rotation.h"

namespace mbdae {

using Mat43 = Eigen::Matrix<double, 4, 3>;
using Mat34 = Eigen::Matrix<double, 3, 4>;

/// qdot = Q(q) w / 2
inline Mat43 quaternion_rates(const Eigen::Vector4d& q) {
  Mat43 Q;
  Q.row(0) = -q.tail<3>().transpose();
  Q.bottomRows<3>() = -skew(q.tail<3>());
  Q.bottomRows<3>().diagonal().array() += q(0);
  return Q;
}

/// dphi = T(q) dq: exact for the rotation of q / |q|.
inline Mat34 rotation_variation(const Eigen::Vector4d& q) {
  return (2.0 / q.squaredNorm()) * quaternion_rates(q).transpose();
}

/// d(Q(q) u)/dq
inline Eigen::Matrix4d quaternion_rates_derivative(const Vec3& u) {
  Eigen::Matrix4d L;
  L(0, 0) = 0.0;
  L.block<1, 3>(0, 1) = -u.transpose();
  L.block<3, 1>(1, 0) = u;
  L.bottomRightCorner<3, 3>() = skew(u);
  return L;
}

}  // namespace mbdae
